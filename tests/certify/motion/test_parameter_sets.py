"""Sets of the true arm's parameters as a region of inertial parameters."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import slidax as sx
from slidax.certify.motion.admission import certified_law, tracking_bound
from slidax.certify.motion.body_points import pseudo_inertias
from slidax.certify.motion.parameter_region import ParameterRegion
from slidax.core.errors import DefinitionError
from slidax.identify.band import arm_parameters, inertial_regressor
from slidax.identify.regressor import BODY, PAIRS, JointMotion
from slidax.scenarios.family import Family

PANDA = "examples/motions/panda.yaml"
LOAD = {"robot.plant.load": {"mass": 0.1, "center": [0.0, 0.02, 0.1], "inertia": 0.001}}
ROTORS = {"robot.plant.armature": 0.1}
SETS: dict[str, dict[str, Any]] = {
    "all bodies": {"robot.plant.mass_factor": {"around": "2 %"}},
    "each body and rotor": {
        "robot.plant.mass_factor": {"around": "2 %", "each": "joint"},
        "robot.plant.inertia_factor": {"between": [0.95, 1.05]},
        "robot.plant.armature": {"around": "2 %", "each": "joint"},
    },
    "payload": {"robot.plant.load.mass": {"between": [0.05, 0.15]}, "robot.plant.mass_factor": {"around": "1 %"}},
}


def scenario(sets: dict[str, Any], **changes: Any) -> Any:
    more = LOAD if any("load" in path for path in sets) else {}
    return sx.scenarios.load(PANDA, {"uncertainty": sets, **ROTORS, **more, **changes})


def region(sets: dict[str, Any], **changes: Any) -> ParameterRegion:
    area = certified_law(scenario(sets, **changes)).uncertainty.band
    assert isinstance(area, ParameterRegion)
    return area


def parameters_of(pseudo: np.ndarray) -> np.ndarray:
    """The ten numbers of each body [r 10n], from pseudo-inertias [r n 4 4]."""
    spread, (i, j) = pseudo[..., :3, :3], np.array(PAIRS).T
    inertia = np.trace(spread, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - spread
    parts = pseudo[..., 3, 3:], pseudo[..., 3, :3], inertia[..., i, j]
    return np.concatenate(parts, axis=-1).reshape(len(pseudo), -1)


@pytest.mark.parametrize("name", SETS)
def test_random_arms_of_a_set_lie_within_its_parameter_region(name: str) -> None:
    whole = scenario(SETS[name])
    area, rng = region(SETS[name]), np.random.default_rng(0)
    family, nominal = Family.of(whole.description), whole.controller.nominal
    dimensions, largest = family.uncertain.dimensions, np.zeros(2)
    rows = np.concatenate([parameters_of(area.deviations), area.rotor_deviations], axis=1)
    cover = np.swapaxes(area.points, 1, 2) @ area.points
    states = rng.uniform(-1.5, 1.5, (20, 7))
    # Some combinations of parameters affect no torque, so that torques are compared.
    regressor = inertial_regressor(nominal, JointMotion(*rng.uniform(-1.5, 1.5, (3, 20, 7)))).reshape(-1, rows.shape[1])
    masses = [np.asarray(nominal.mass(jnp.asarray(q))) for q in states]
    for run in range(12):
        corner = np.full(dimensions, float(run % 2)) if run < 2 else rng.integers(0, 2, dimensions).astype(float)
        drawn = family.uncertain.values(np.minimum(corner, np.nextafter(1.0, 0.0))[None])
        plant = family.scenario({path: value[0] for path, value in drawn.items()}, "arm").plant
        arm = plant.robot
        if plant.load is not None:
            arm = eqx.tree_at(lambda arm: arm.payload, arm, arm.payload.joined(plant.load.payload))
        apart = arm_parameters(arm) - arm_parameters(nominal)
        for q, mass in zip(states, masses, strict=True):
            relative = np.linalg.solve(mass, np.asarray(arm.mass(jnp.asarray(q))) - mass)
            largest[0] = max(largest[0], np.max(np.abs(np.linalg.eigvals(relative))) / area.p)
        bodies, rotors = pseudo_inertias(apart[: BODY * 7]), apart[BODY * 7 :]
        # With a known difference, the cover belongs to other parameters with the same torques.
        for sign in (-1.0, 1.0) if "difference" not in area.title else ():
            slack = np.linalg.eigvalsh(cover + sign * bodies).min()
            assert slack >= -1e-9 * np.abs(cover).max()
        assert np.all(np.abs(rotors) <= area.rotors * (1 + 1e-9) + 1e-12)
        torque = regressor @ apart
        share = np.linalg.lstsq(regressor @ rows.T, torque, rcond=1e-10)[0]
        assert np.linalg.norm(regressor @ rows.T @ share - torque) <= 1e-6 * np.linalg.norm(torque)
        largest[1] = max(largest[1], np.linalg.norm(share))
    assert largest[0] <= 1.0 + 1e-9 and largest[1] <= 1.0 + 1e-9
    assert largest[0] > 0.5


def test_simulated_arms_with_uncertain_payload_stay_within_the_tracking_bound() -> None:
    sets = {**SETS["payload"], "robot.plant.coulomb": {"between": [0.0, 0.3]}}
    whole = scenario(sets)
    verdict = tracking_bound(whole)
    assert verdict.holds
    family = Family.of(whole.description)
    for corner in (0.0, np.nextafter(1.0, 0.0)):
        drawn = family.uncertain.values(np.full((1, family.uncertain.dimensions), corner))
        log = family.scenario({path: value[0] for path, value in drawn.items()}, "arm").simulate().log
        assert np.all(np.abs(np.asarray(log.e)).max(axis=0) < verdict.bound["error"])


def test_parameter_region_ignores_order_and_padding_and_grows_with_the_set() -> None:
    sets = SETS["each body and rotor"]
    padding = {"start.q": {"around": 0.0}, "robot.plant.viscous": {"between": [0.2, 0.2]}}
    plain, other = region(sets), region({**padding, **dict(reversed(sets.items()))})
    for name in ("p", "points", "rotors", "deviations", "rotor_deviations"):
        np.testing.assert_array_equal(getattr(plain, name), getattr(other, name))
    sizes = [
        region({"robot.plant.mass_factor": {"around": f"{share} %", "each": "joint"}}) for share in (0.5, 1.0, 2.0)
    ]
    for less, more in ((sizes[0], sizes[1]), (sizes[1], sizes[2])):
        assert less.p < more.p
        assert np.all(np.linalg.norm(less.points, axis=(1, 2)) <= np.linalg.norm(more.points, axis=(1, 2)))


def test_mass_factor_shared_by_all_joints_adds_a_single_deviation_to_the_region() -> None:
    alike = region({"robot.plant.mass_factor": {"around": "2 %"}})
    each = region({"robot.plant.mass_factor": {"around": "2 %", "each": "joint"}})
    assert len(alike.deviations) == 1 and len(each.deviations) == 7
    np.testing.assert_allclose(alike.p, each.p, rtol=1e-6)


def test_set_that_is_not_affine_is_refused_and_a_band_is_certified() -> None:
    sets = {"robot.plant.load.center": {"ball": 0.01}}
    with pytest.raises(DefinitionError, match=r"not affine in `robot\.plant\.load\.center`"):
        certified_law(scenario(sets))
    assert tracking_bound(scenario({"robot.plant.inertial": {"band": 0.01}})).holds


def test_sets_that_change_more_than_the_whole_inertia_are_refused() -> None:
    with pytest.raises(DefinitionError, match="make the uncertainty sets narrower"):
        certified_law(scenario({"robot.plant.load.mass": {"between": [1.0, 30.0]}}))
