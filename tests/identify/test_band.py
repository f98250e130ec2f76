"""The band of an identified arm: relative bounds of its mass matrix, torque errors, intervals and their coverage."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

import slidax as sx
from slidax.arms.arm import Payload
from slidax.arms.assemble import assemble
from slidax.arms.joint import Joint
from slidax.arms.mismatch import Mismatch
from slidax.core.errors import DefinitionError, as_array
from slidax.identify import identify, write_arm
from slidax.identify.band import EstimateErrors, arm_parameters, band_of, base_parameters, inertial_regressor
from slidax.identify.mass_bound import MassBound
from slidax.identify.regression import covariance_of_fit
from slidax.identify.regressor import BODY, JointMotion, parameters_of_body, payload_regressor
from slidax.scenarios.uncertain_values import Leaf
from slidax.scenarios.uncertainty import INERTIAL_PATH, InertialBand
from tests.identify.recorded import moved, recorded

PAYLOAD = Payload(
    mass=as_array(1.0), center=as_array([0.02, -0.03, 0.05]), inertia=as_array(np.diag([4e-3, 5e-3, 6e-3]))
)


def arm_with_drives(name):
    arm = sx.arms.from_urdf("tests/identify/three_link.urdf") if name == "three_link" else getattr(sx.arms, name)()
    n = arm.joints
    values = (as_array(np.linspace(0.2, 0.1, n)), as_array(np.full(n, 0.8)), as_array(np.full(n, 0.4)), PAYLOAD)
    return eqx.tree_at(lambda robot: (robot.armature, robot.coulomb, robot.viscous, robot.payload), arm, values)


def planar_arm_with_a_slide():
    bodies = {
        "upper": (3.0, [0.2, 0.0, 0.0], 0.05),
        "fore": (2.0, [0.15, 0.0, 0.0], 0.03),
        "rod": (1.0, [0.02, 0.0, -0.1], 0.002),
    }
    joints, parent, place = [], None, [0.0, 0.0, 0.0]
    for name, (mass, center, moment) in bodies.items():
        joints.append(
            Joint(
                f"{name}_joint",
                kind="prismatic" if name == "rod" else "revolute",
                parent=parent,
                link=name,
                axis=[0.0, 0.0, 1.0],
                translation=place,
                mass=mass,
                center=center,
                inertia=np.diag([0.01, 0.01 + moment, 0.01 + moment]),
            )
        )
        parent, place = f"{name}_joint", [2.0 * center[0], 0.0, 0.0]
    return assemble(joints, tip="rod")


def mass_matrices(arm, parameters, q):
    """M(q) for parameters [11n] by the regressor of unit accelerations without gravity."""
    still = eqx.tree_at(lambda robot: robot.gravity_vector, arm, as_array(np.zeros(3)))
    zero = np.zeros_like(q)
    columns = [
        inertial_regressor(still, JointMotion(q, zero, zero + np.eye(arm.joints)[j])) @ parameters
        for j in range(arm.joints)
    ]
    return np.stack(columns, axis=2)


def relative(arm, parameters, error, q):
    """The largest relative error of M over q, [k]."""
    root = np.linalg.inv(np.linalg.cholesky(mass_matrices(arm, parameters, q)))
    scaled = root @ mass_matrices(arm, error, q) @ np.swapaxes(root, 1, 2)
    return np.abs(np.linalg.eigvalsh(scaled)).max(axis=1)


def random_errors(arm, count, seed=0):
    """Random parameter errors with a similar effect on all torques."""
    base, scale = base_parameters(arm)
    return (np.random.default_rng(seed).normal(size=(count, base.shape[1])) @ base.T) * scale * 1e-2


@pytest.mark.parametrize("name", ["three_link", "ur5e", "panda"])
def test_mass_matrix_error_bound_is_not_exceeded_and_at_most_half_too_large(name):
    arm = arm_with_drives(name)
    parameters, errors = arm_parameters(arm), random_errors(arm, 3)
    bounds = MassBound(arm, parameters).of(errors)
    rng = np.random.default_rng(1)
    for error, bound in zip(errors, bounds, strict=True):
        q = rng.uniform(-np.pi, np.pi, (400, arm.joints))
        size = relative(arm, parameters, error, q)
        best = q[np.argsort(size)[-4:]]
        # Climb from the best samples.
        for step in np.geomspace(0.5, 0.01, 12):
            near = (best[:, None] + step * rng.normal(size=(1, 40, arm.joints))).reshape(-1, arm.joints)
            near = np.concatenate([best, near])
            best = near[np.argsort(relative(arm, parameters, error, near))[-4:]]
        largest = relative(arm, parameters, error, best).max()
        assert largest <= bound * (1.0 + 1e-9)
        assert bound <= 1.5 * largest


def test_mass_matrix_error_bound_of_a_scaled_arm_is_its_scale_error():
    arm = arm_with_drives("ur5e")
    parameters = arm_parameters(arm)
    np.testing.assert_allclose(MassBound(arm, parameters).of(0.03 * parameters[None]), 0.03, rtol=0.03)


def test_mass_matrix_error_bound_scales_with_the_error_and_refinement_does_not_increase_it():
    arm = arm_with_drives("panda")
    bound, errors = MassBound(arm, arm_parameters(arm)), random_errors(arm, 5)
    np.testing.assert_allclose(bound.of(3.0 * errors), 3.0 * bound.of(errors), rtol=1e-6)
    np.testing.assert_allclose(bound.of(-errors), bound.of(errors), rtol=1e-6)
    assert (bound.of(errors) <= bound.of(errors, refine=False)).all()


@pytest.mark.parametrize("name", ["three_link", "ur5e", "panda"])
def test_unidentifiable_parameters_do_not_change_the_mass_matrix_error_bound(name):
    arm = arm_with_drives(name)
    base, scale = base_parameters(arm)
    rng = np.random.default_rng(2)
    some = rng.normal(size=(5, len(scale)))
    hidden = (some - some @ base @ base.T) * scale
    motion = JointMotion(*rng.normal(size=(3, 50, arm.joints)))
    np.testing.assert_allclose(inertial_regressor(arm, motion) @ hidden.T, 0.0, atol=1e-9)
    assert MassBound(arm, arm_parameters(arm)).of(hidden).max() < 1e-8


def test_mass_matrix_error_bound_holds_for_a_planar_arm_with_a_prismatic_joint():
    scara = planar_arm_with_a_slide()
    parameters = arm_parameters(scara)
    errors = random_errors(scara, 20)
    bounds = MassBound(scara, parameters).of(errors)
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (2000, 3))
    for error, bound in zip(errors, bounds, strict=True):
        size = relative(scara, parameters, error, q).max()
        assert size <= bound * (1.0 + 1e-9) and bound <= 1.3 * size


def test_a_mass_matrix_error_bound_of_an_arm_without_mass_is_refused():
    arm = arm_with_drives("ur5e")
    with pytest.raises(DefinitionError, match="no mass or no inertia"):
        MassBound(arm, 0.0 * arm_parameters(arm))


def test_inertial_regressor_times_arm_parameters_is_the_arms_torque():
    arm = arm_with_drives("panda")
    q, dq, ddq = np.random.default_rng(0).normal(size=(3, 7))
    torque = arm.mass(as_array(q)) @ ddq + arm.bias(as_array(q), as_array(dq))
    row = inertial_regressor(arm, JointMotion(q[None], dq[None], ddq[None]))[0]
    np.testing.assert_allclose(row @ arm_parameters(arm), torque, rtol=1e-9)


def test_payload_errors_bound_the_torque_by_the_radius_of_their_confidence_ellipsoid():
    arm = arm_with_drives("panda")
    names = tuple(f"payload.{k}" for k in range(BODY))
    payload = arm.payload
    own = parameters_of_body(float(payload.mass), np.asarray(payload.center), np.asarray(payload.inertia))
    estimate = EstimateErrors(names, (-1,) * BODY, (0,), own, np.diag((0.01 * own.max()) ** 2 * np.ones(BODY)))
    band = band_of(arm, estimate)
    motion = JointMotion(*np.random.default_rng(0).normal(size=(3, 20, 7)))
    rows = payload_regressor(arm, motion) * 0.01 * own.max()
    # With errors in ten directions, the bound is the radius times the torque of one standard error.
    ratio = band.torque_error(arm, motion) / np.linalg.norm(rows, axis=2)
    np.testing.assert_allclose(ratio[:, 1:], ratio[0, 1], rtol=1e-6)
    assert ratio[0, 1] ** 2 == pytest.approx(stats.chi2(10).ppf(0.95), rel=0.15)
    assert band.coulomb.size == 0 and not band.links


def estimate_of(arm, size=1e-2, seed=0):
    """An estimate of all parameters with a covariance of full rank."""
    n = arm.joints
    parameters = np.concatenate([arm_parameters(arm), np.asarray(arm.coulomb), np.asarray(arm.viscous)])
    names = [f"link.{k}" for k in range(BODY)] * n + [
        name for name in ("armature", "coulomb", "viscous") for _ in range(n)
    ]
    joints = [joint for joint in range(n) for _ in range(BODY)] + list(range(n)) * 3
    factor = np.random.default_rng(seed).normal(size=(len(parameters), 2 * len(parameters)))
    _, scale = base_parameters(arm)
    unit = size * np.concatenate([scale, np.full(2 * n, 1.0)])
    covariance = factor @ factor.T / factor.shape[1] * np.outer(unit, unit)
    bodies = tuple(range(0, BODY * n, BODY))
    return EstimateErrors(tuple(names), tuple(joints), bodies, parameters, covariance)


def bare(arm):
    """The arm with its payload merged into its last link, as an estimate of links has it."""
    return eqx.tree_at(lambda robot: robot.payload, arm, Payload(mass=as_array(0.0)))


@pytest.fixture(scope="module")
def three_link():
    arm = bare(arm_with_drives("three_link"))
    estimate = estimate_of(arm)
    return arm, estimate, band_of(arm, estimate)


def test_all_bounds_of_an_identified_band_hold_jointly_in_95_percent_of_draws(three_link):
    arm, estimate, band = three_link
    n, count = arm.joints, 1500
    factor = np.linalg.cholesky(estimate.covariance)
    errors = np.random.default_rng(5).normal(size=(count, len(factor))) @ factor.T
    holds = MassBound(arm, arm_parameters(arm)).of(errors[:, : 11 * n]) <= band.p
    base, scale = base_parameters(arm)
    deviations = (band.deviations / scale) @ base
    shares = np.linalg.solve(deviations @ deviations.T, deviations @ (errors[:, : 11 * n] / scale @ base).T)
    holds &= np.linalg.norm(shares, axis=0) <= 1.0
    for k, name in enumerate(("armature", "coulomb", "viscous")):
        own = errors[:, 10 * n + k * n :][:, :n]
        half = getattr(band, name)[1] - getattr(arm, name)
        holds &= (np.abs(own) <= half).all(axis=1)
    assert abs(holds.mean() - 0.95) < 0.02


def test_torque_error_of_a_band_is_the_largest_over_its_ellipsoid(three_link):
    arm, _, band = three_link
    rng = np.random.default_rng(0)
    motion = JointMotion(*rng.normal(size=(3, 30, arm.joints)))
    bound = band.torque_error(arm, motion)
    rows = inertial_regressor(arm, motion)
    some = rng.normal(size=(200, len(band.deviations)))
    some /= np.linalg.norm(some, axis=1, keepdims=True)
    assert (np.abs(rows @ (some @ band.deviations).T) <= bound[:, :, None] * (1 + 1e-12)).all()
    worst = rows[3, 1] @ band.deviations.T
    attained = rows[3, 1] @ (worst / np.linalg.norm(worst) @ band.deviations)
    assert attained == pytest.approx(bound[3, 1])


def test_a_larger_covariance_gives_a_wider_band(three_link):
    arm, estimate, band = three_link
    wider = band_of(arm, EstimateErrors(*list(vars(estimate).values())[:4], 4.0 * estimate.covariance))
    assert wider.p == pytest.approx(2.0 * band.p)
    np.testing.assert_allclose(wider.deviations @ wider.deviations.T, 4.0 * band.deviations @ band.deviations.T)


def test_standard_errors_are_correct_for_correlated_noise():
    # 40 s at 30 Hz, six columns of 30 harmonics each, noise with a time constant of 0.3 s.
    k, rate, runs = 1200, 30.0, 400
    angle = 2.0 * np.pi * 0.1 * np.outer(np.arange(k) / rate, np.arange(1, 31))
    waves = np.concatenate([np.sin(angle), np.cos(angle)], axis=1)
    columns = (waves @ np.random.default_rng(1).normal(size=(60, 6)))[:, None]
    rng = np.random.default_rng(0)
    noise = rng.normal(size=(runs, k))
    for i in range(1, k):
        noise[:, i] = 0.9 * noise[:, i - 1] + noise[:, i] * np.sqrt(1 - 0.9**2)
    inverse = np.linalg.inv(columns[:, 0].T @ columns[:, 0])
    errors = noise @ columns[:, 0] @ inverse
    residuals = noise - errors @ columns[:, 0].T
    counts = np.ones((k, 1), bool)
    variances = np.array(
        [np.diag(covariance_of_fit(columns, r[:, None], counts, inverse, rate, 10.0)) for r in residuals]
    )
    ratio = np.sqrt(variances.mean(axis=0) / errors.var(axis=0))
    # Errors of white noise would be half as large.
    assert np.diag(inverse).max() < 0.3 * errors.var(axis=0).max()
    assert (ratio > 0.9).all() and (ratio < 1.35).all()
    assert 0.93 < np.mean(np.abs(errors) < 1.96 * np.sqrt(variances)) < 0.99


def log_of(arm, seed, seconds=20.0):
    motion = moved(seconds, 125.0, arm.joints, seed=3 + seed, size=2.5)
    return recorded(arm, noise=0.01, seed=seed, times_and_motion=motion)


def covered(result, arm):
    """True if the band of a result holds the true arm."""
    band = result.band
    off = arm_parameters(arm) - arm_parameters(result.robot)
    holds = [MassBound(result.robot, arm_parameters(result.robot)).of(off[None])[0] <= band.p]
    base, scale = base_parameters(arm)
    share, *_ = np.linalg.lstsq(((band.deviations / scale) @ base).T, base.T @ (off / scale), rcond=None)
    holds.append(np.linalg.norm(share) <= 1.0)
    for name in ("armature", "coulomb", "viscous"):
        lower, upper = getattr(band, name)
        holds.append(bool((lower <= getattr(arm, name)).all() and (getattr(arm, name) <= upper).all()))
    return all(holds)


@pytest.mark.full
def test_true_arm_lies_in_the_band_of_93_to_99_percent_of_200_logs():
    arm, known = arm_with_drives("three_link"), sx.arms.from_urdf("tests/identify/three_link.urdf")
    inside = [covered(identify(log_of(arm, seed), known, links=True), arm) for seed in range(200)]
    assert 0.93 <= np.mean(inside) <= 0.99


def test_true_arm_lies_in_the_band_of_at_least_two_of_three_logs():
    arm, known = arm_with_drives("three_link"), sx.arms.from_urdf("tests/identify/three_link.urdf")
    results = [identify(log_of(arm, seed), known, links=True) for seed in (1, 2, 3)]
    assert sum(covered(result, arm) for result in results) >= 2
    assert all(result.band.p < 0.05 for result in results)


def test_a_longer_log_makes_the_band_narrower():
    arm, known = arm_with_drives("three_link"), sx.arms.from_urdf("tests/identify/three_link.urdf")
    short, long = (identify(log_of(arm, 0, seconds), known).band for seconds in (10.0, 40.0))
    assert long.p < 0.75 * short.p
    assert not short.links and "exact links" in str(short)


def test_arm_file_has_the_band_as_an_uncertainty_set(tmp_path):
    arm, known = arm_with_drives("three_link"), sx.arms.from_urdf("tests/identify/three_link.urdf")
    result = identify(log_of(arm, 0), known, links=True)
    write_arm(result, {"kind": "urdf", "file": "tests/identify/three_link.urdf"}, tmp_path / "arm.yaml")
    (tmp_path / "scenario.yaml").write_text(
        "title: identified\nrobot: {kind: identified, file: arm.yaml}\nuncertainty: {file: arm.yaml}\n"
        "trajectory: {kind: minimum_jerk, times: [0, 1], waypoints: [[0, 0, 0], [0.3, 0.3, 0.3]]}\n"
        "scheme: {name: computed_torque}\nstart: {q: [0, 0, 0]}\nsimulation: {mode: held, period: 1.0e-3, t1: 1.0}\n"
    )
    scenario = sx.scenarios.load(tmp_path / "scenario.yaml")
    band = scenario.description.uncertainty[INERTIAL_PATH]
    assert band.band == pytest.approx(result.band.p, rel=1e-3) and band.confidence == result.band.confidence
    np.testing.assert_allclose(band.deviations, result.band.deviations, rtol=1e-4)
    friction = scenario.description.uncertainty["robot.plant.coulomb"]
    np.testing.assert_allclose(friction.between, result.band.coulomb, rtol=1e-4)
    np.testing.assert_allclose(scenario.controller.nominal.viscous, result.robot.viscous, rtol=1e-6)
    assert f"p = {100 * band.band:.2g} %" in str(result)


def test_arms_drawn_from_an_identified_band_are_within_it():
    arm, known = arm_with_drives("three_link"), sx.arms.from_urdf("tests/identify/three_link.urdf")
    result = identify(log_of(arm, 0), known, links=True)
    band = InertialBand(band=result.band.p, deviations=result.band.deviations.tolist())
    leaf = Leaf(INERTIAL_PATH, None, 3, arm=lambda: result.robot)
    rng = np.random.default_rng(0)
    changes = band.values(rng.random((200, band.coordinates(leaf))), leaf)
    flat = np.concatenate([changes[:, :10].swapaxes(1, 2).reshape(200, -1), changes[:, 10]], axis=1)
    xi = np.linalg.lstsq(result.band.deviations.T, flat.T, rcond=None)[0]
    assert (np.linalg.norm(xi, axis=0) <= 1 + 1e-9).all() and np.linalg.norm(xi, axis=0).max() > 0.5
    for change in changes[:20]:
        true = Mismatch(inertial=change).applied(result.robot)
        for q in jnp.asarray(rng.uniform(-3, 3, (20, 3))):
            factor = np.linalg.inv(np.linalg.cholesky(np.asarray(result.robot.mass(q))))
            size = np.linalg.eigvalsh(factor @ np.asarray(true.mass(q)) @ factor.T - np.eye(3))
            assert np.abs(size).max() <= result.band.p
