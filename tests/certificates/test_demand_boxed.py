"""What a set asks for is no less where its linear parts are counted as what is not known."""

import numpy as np

from slidax.certificates.demand import Demand


def test_boxed_in_it_covers_every_member_of_the_set():
    rng = np.random.default_rng(0)
    push, effects = rng.normal(size=(2, 5, 3)), rng.normal(size=(2, 4, 5, 3))
    kappa, coupling = np.ones((2, 3)), np.zeros((3, 3))
    whole = Demand(np.arange(5.0), push, np.full((5, 3), 0.1), kappa, coupling, [], effects=effects)
    boxed = whole.boxed()
    assert boxed.effects is None
    for _ in range(100):
        share, x = rng.dirichlet([1.0, 1.0]), rng.choice([-1.0, 1.0], 4)
        asked = np.einsum("m,mkj->kj", share, push + np.einsum("e,mekj->mkj", x, effects))
        middle = np.einsum("m,mkj->kj", share, push)
        assert (np.abs(asked - middle) + 0.1 <= boxed.stray + 1e-12).all()
    assert boxed.boxed() is boxed
