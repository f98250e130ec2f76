import pytest

from .runs import two_link


@pytest.fixture(scope="package")
def swing():
    scenario = two_link()
    return scenario.plant, scenario.simulate(progress=False)
