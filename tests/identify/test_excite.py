"""Excitation motions for the identification of an arm."""

import numpy as np
import pytest

import slidax as sx
from slidax.arms import Payload
from slidax.core.errors import DefinitionError, as_array
from slidax.identify import excitation, excite
from slidax.identify.excitation import FourierSeries
from slidax.identify.regressor import parameters_of_links, parameters_of_payload, rigid_torque
from slidax.motions import Tabulated

ARM = sx.arms.ur5e()
LOAD = Payload(mass=as_array(3.0))


@pytest.fixture(scope="module")
def motion():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(excitation, "STARTS", 10)
        patch.setattr(excitation, "STEPS", 40)
        return excite(ARM, seed=1, duration=10.0, payload=LOAD, share=0.7)


def test_excitation_begins_and_ends_at_rest_in_the_same_posture(motion):
    for part in (motion.motion.dq, motion.motion.ddq):
        np.testing.assert_allclose(part[[0, -1]], 0.0, atol=1e-12)
    np.testing.assert_allclose(motion.motion.q[0], motion.motion.q[-1], atol=1e-12)


def test_excitation_keeps_position_limits_and_its_share_of_velocity_and_torque_limits(motion):
    limits, q = ARM.limits, motion.motion.q
    assert (q >= np.asarray(limits.lower)).all() and (q <= np.asarray(limits.upper)).all()
    assert (np.abs(motion.motion.dq) <= 0.7 * np.asarray(limits.velocity) * (1 + 1e-9)).all()
    torque = rigid_torque(ARM, motion.motion, parameters_of_links(ARM), parameters_of_payload(LOAD))
    assert (np.abs(torque) <= 0.7 * np.asarray(limits.torque) * (1 + 1e-9)).all()
    # Each joint reaches one of its limits.
    assert (motion.share[:3].max(axis=0) > 0.7 * 0.98).all()


def test_excitation_velocity_is_the_derivative_of_its_position(motion):
    slope = np.gradient(motion.motion.q, motion.t, axis=0)[2:-2]
    np.testing.assert_allclose(slope, motion.motion.dq[2:-2], atol=0.02)


def test_the_excitation_file_is_read_as_a_tabulated_motion(motion, tmp_path):
    motion.write(tmp_path / "motion.csv")
    read = Tabulated.from_csv(tmp_path / "motion.csv", joints=list(ARM.joint_names), velocity=ARM.limits.velocity)
    assert float(read.until) == pytest.approx(10.0)
    np.testing.assert_allclose(read.position(as_array(motion.t[37])), motion.motion.q[37], atol=1e-8)


def test_excitation_is_more_informative_than_random_motions(motion):
    series = FourierSeries(5.0, 10)
    search = excitation.ExcitationSearch(ARM, 0.7, None, None, LOAD, links=False)
    random = (series.random(np.random.default_rng(seed), 6) for seed in range(10))
    chance = [search.score(search.scaled_motion(series, shape, excitation.POINTS)) for shape in random]
    assert motion.information > max(chance) and "bits" in str(motion) and ARM.joint_names[0] in str(motion)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"harmonics": 2}, "rest at both ends takes two"),
        ({"share": 1.5}, r"`share` of an excitation motion must be in \(0, 1\]"),
        ({"duration": 0.0}, "`duration`"),
        ({"acceleration": -1.0}, "> 0 and finite"),
        ({"center": np.zeros(3)}, "one position for each of the 6 joints"),
        ({"center": np.full(6, 9.0)}, "within the joints' limits"),
        ({"payload": Payload(mass=as_array(300.0))}, "no excitation motion found within the torque limit"),
    ],
)
def test_invalid_excitation_options_are_refused(changes, words, monkeypatch):
    monkeypatch.setattr(excitation, "STARTS", 2)
    monkeypatch.setattr(excitation, "STEPS", 2)
    with pytest.raises(DefinitionError, match=words):
        excite(ARM, seed=0, **changes)
