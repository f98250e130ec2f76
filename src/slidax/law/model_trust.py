"""Decide which model of an arm a law uses: the learnt one, the last good one, or each joint's own learning.

An innovation is the torque of a window (`least_squares`) less the torque that a model explains. A window is loud for a
model if the innovation of a joint is above `LOUD` times its usual size, and otherwise quiet. A learnt model is good
while it has been in full use for `PROVEN` without a loud window. The last good model is its last copy from such a time.
"""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from slidax.core.types import PerJoint, Scalar, Vector

LOUD = 4.0
"""Innovation of a joint, over its usual size, above which a window is loud: it does not update the parameters."""

USUAL_TIME, ENERGY_TIME = 1.0, 0.3
"""s: time constants for the means of the usual squared innovation, and of the energies that decide.

An energy is a recent mean of the squared innovation of a model, or of the squared torque."""

OF_QUIET, OF_LOUD = 9.0, 2.0
"""Limits of a squared innovation, over the usual one, when it updates the usual one, in a quiet and a loud window."""

EXPLAINS, FAILS = 0.1, 0.25
"""Energy of the innovations over that of the torque: below the first a model explains the torque, above the second it
does not."""

WORSE, WRONG = 4.0, 0.02
"""Energy of a model's innovations over the last good model's and over the torque's, from which the good one returns."""

FLOOR = 5.0
"""Torque, in standard deviations of the noise, whose square is added to a joint's torque energy in these ratios."""

BLIND = 0.025
"""s: time without valid windows, after a loud one or with an unproven model, after which each joint's own learning
replaces the model of the arm."""

UNSURE = 3.0
"""Variance of the torque's noise over the usual squared innovation, for a model that is learnt or on probation."""

LASTING = 0.5
"""s: time of loud windows after which the arm counts as changed, and is learnt anew."""

CONFIRMED, PROBATION, PROVEN = 0.2, 0.6, 1.0
"""s: time in which the last good model must explain the torque before it is used again, time for which a new model must
not fail before it is used, and time in full use after which a model counts as good."""

RELIEF = 0.3
"""s: time in which loud windows update the parameters, too, and leave the arm's model in use. It follows the loss of a
payload, and a change that a first model nearly explains."""

UNEXPLAINED, LEAST_LOST = 0.05, 0.2
"""Share of a loud window's energy that a lost payload may leave, and least share of a payload that is lost at once."""

RUBBED, BACKWARDS, STIFFEST = 0.1, 0.1, 2.0
"""Share of a joint's energy in loud windows that a change of its Coulomb friction may leave; share of the change by
which the new friction may be negative; and the largest new friction, over the largest that a joint learns."""

RISE, FALL = 0.2, 0.1
"""s: times in which the share of the arm's model rises from 0 to 1 and falls from 1 to 0."""


class Trust(eqx.Module):
    """Evidence for the learnt and for the last good model of the arm.

    - `energy`: recent means of the squared innovations of the learnt and of the last good model, and of the squared
      torque [3 n], (N m)² or N².
    - `rubbing`: sums of m², m c and c² over the windows since the first loud one, for the innovation m of the learnt
      model and the direction of motion `c = tanh(q̇/v_1)` [3 n].
    - `usual`: usual squared innovation [n].
    - `share`: α, weight of the arm's model in the model that the law uses; 1 - α is that of the joints' own learning.
    - `relearns`: True while the arm is learnt from the beginning, or anew after a lasting change.
    - `since`: time since `relearns` changed, or since a learning or a probation began anew [s].
    - `loud`: time with loud windows less that with quiet ones [s], at least 0; negative during `RELIEF`.
    - `blind`: time without a valid window, after a loud one or before the model is proven [s].
    - `good`: time of full use without a loud window [s].
    - `confirmed`: time for which the last good model has explained the torque [s].
    - `has_good`: True if there is a last good model.
    """

    energy: Float[Array, "3 n"]
    rubbing: Float[Array, "3 n"]
    usual: Vector
    share: Scalar
    relearns: Bool[Array, ""]
    since: Scalar
    loud: Scalar
    blind: Scalar
    good: Scalar
    confirmed: Scalar
    has_good: Bool[Array, ""]

    @classmethod
    def init(cls, joints: int, variance: PerJoint) -> Trust:
        """Return the evidence before the first window.

        - `variance`: variance of a window's torque noise, one number or [n], (N m)² or N².
        """
        nothing = jnp.zeros(())
        return cls(
            energy=jnp.zeros((3, joints)),
            rubbing=jnp.zeros((3, joints)),
            usual=jnp.zeros(joints) + variance,
            share=nothing,
            relearns=jnp.ones((), bool),
            since=nothing,
            loud=nothing,
            blind=nothing,
            good=nothing,
            confirmed=nothing,
            has_good=jnp.zeros((), bool),
        )

    def noise(self, variance: PerJoint) -> Vector:
        """Return the noise variance for the least squares [n], (N m)² or N².

        It is larger while the model is learnt or on probation, so that no single event decides a parameter.

        - `variance`: variance of a window's torque noise, which is returned for a proven model.
        """
        return jnp.where(self.relearns | (self.since < PROBATION), UNSURE * self.usual, variance)

    def after_window(
        self,
        innovations: Float[Array, "2 n"],
        torque: Vector,
        direction: Vector,
        heard: Bool[Array, " n"],
        variance: PerJoint,
        duration: Scalar,
    ) -> tuple[Trust, Bool[Array, "2"]]:
        """Return the evidence after a window, and True if it is loud for the learnt, and for the last good model [2].

        A window without motion is no evidence for the last good model: it counts as loud for that model.

        - `innovations`: innovations of the learnt and of the last good model [2 n], N m or N.
        - `torque`: torque that a model has to explain [n], N m or N.
        - `direction`: c, mean of `tanh(q̇/v_1)` [n].
        - `heard`: True for each joint that moves in a valid window.
        - `variance`: variance of a window's torque noise, (N m)² or N².
        - `duration`: time from one window to the next [s].
        """
        squares = jnp.square(jnp.concatenate([innovations, torque[None]]))
        loud = jnp.any(heard & (squares[:2] > LOUD * LOUD * self.usual), axis=1)
        loud = loud | jnp.stack([jnp.zeros((), bool), ~jnp.any(heard)])
        newer = jnp.where(heard, -jnp.expm1(-duration / ENERGY_TIME), 0.0)
        slower = jnp.where(heard, -jnp.expm1(-duration / USUAL_TIME), 0.0)
        # Neither outliers nor pushes may become usual before a lasting change is found.
        unusual = loud[0] & ~self.relearns & (self.loud >= 0.0)
        clipped = jnp.minimum(squares[0], jnp.where(unusual, OF_LOUD, OF_QUIET) * self.usual)
        energy = self.energy + newer * (squares - self.energy)
        usual = jnp.maximum(self.usual + slower * (clipped - self.usual), variance)
        rubbing = jnp.where(heard, jnp.stack([squares[0], innovations[0] * direction, direction * direction]), 0.0)
        rubbing = jnp.where(self.loud > 0.0, self.rubbing, 0.0) + rubbing
        parts = energy, rubbing, usual
        return eqx.tree_at(lambda trust: (trust.energy, trust.rubbing, trust.usual), self, parts), loud

    def friction_change(
        self, coulomb: Vector, coulomb_max: PerJoint, duration: Scalar
    ) -> tuple[Bool[Array, ""], Vector]:
        """Return True if changes of Coulomb friction explain the loud windows, and these changes [n], N m or N.

        - `coulomb`: Coulomb friction of the learnt model [n], N m or N.
        - `coulomb_max`: largest Coulomb friction that a joint learns, N m or N.
        - `duration`: time from one window to the next [s].
        """
        squares, products, directions = self.rubbing
        usual = UNSURE * self.usual * self.loud / duration
        quiet = squares <= usual
        change = jnp.where(quiet, 0.0, products / jnp.maximum(directions, 1.0))
        left = squares - change * (2.0 * products - change * directions)
        new = coulomb + change
        possible = (new > -BACKWARDS * jnp.abs(change)) & (new < STIFFEST * coulomb_max)
        return jnp.all(quiet | possible & (left < RUBBED * squares + usual)), change

    def weights(self, squares: Vector, loud: Bool[Array, ""]) -> Vector:
        """Return the weights of a window's equations in the least squares [n], 0 (not used) to 1.

        While the arm is learnt, loud windows count, too. After the time `PROVEN` of learning, an equation counts less
        the larger its innovation is, so that an external push does not replace earlier information. Once the arm is
        learnt, a loud window has the weight 0, except during `RELIEF`.

        - `self`: the evidence before the window.
        - `squares`: squared innovations of the learnt model [n], (N m)² or N².
        - `loud`: True if the window is loud for that model.
        """
        robust = jnp.minimum(1.0, LOUD * LOUD * self.usual / jnp.maximum(squares, self.usual))
        learning = jnp.where(self.since > PROVEN, robust, 1.0)
        return jnp.where(self.relearns, learning, jnp.where(loud & (self.loud >= 0.0), 0.0, 1.0))


class Verdict(eqx.Module):
    """Decision of `judge` about the models after a window.

    - `restores`: True to continue with the last good model in place of the learnt one.
    - `opens`: True to enlarge the covariance, since the arm has changed.
    - `keeps`: True to take the learnt model as the last good one.
    - `unloads`: True to subtract the lost share of the payload from the learnt model.
    - `rubs`: True to add the change of friction to the learnt model.
    """

    restores: Bool[Array, ""]
    opens: Bool[Array, ""]
    keeps: Bool[Array, ""]
    unloads: Bool[Array, ""]
    rubs: Bool[Array, ""]


def judge(
    trust: Trust,
    certain: Bool[Array, ""],
    valid: Bool[Array, ""],
    loud: Bool[Array, "2"],
    lost: Scalar,
    left: Vector,
    rubbed: Bool[Array, ""],
    variance: PerJoint,
    duration: Scalar,
) -> tuple[Trust, Verdict]:
    """Decide after a window which model the law uses; return the evidence after the decision, and the decision.

    - Push or contact: a loud window updates no parameters, and the arm's model stays in use.
    - Lost samples, as when predictions fail: after a loud window, or with a model that is not `PROVEN`, they count as
      loud. The joints' own learning replaces the model after `BLIND`.
    - Lasting change: after `LASTING` of loud windows the arm is learnt anew, with the joints' own learning in use. The
      new model is used once it knows each inertia and then has not failed for `PROBATION`; most pushes are shorter.
      The last good model returns once it has explained the torque for `CONFIRMED`. It also replaces a model in use that
      explains the torque less well, or whose windows are loud for `CONFIRMED` while those of the good model are not.
    - A model that fails while it is learnt is learnt anew. After the time `PROVEN` of learning, this needs loud windows
      for `LASTING`.
    - Without a good model: a first model that misses less than the share `EXPLAINS` of the torque's energy stays in
      use instead of being learnt anew. For `RELIEF` all windows update it.
    - Lost payload: if it explains two windows in a row, the model changes at once and stays in use. The innovation that
      remains counts as usual, and for `RELIEF` all windows update the model.
    - Changed friction: if it explains the loud windows of a lasting change, the model takes it over and stays in use.

    - `trust`: evidence before the decision, from `Trust.after_window`.
    - `certain`: True if the model knows each joint's inertia.
    - `valid`: True for a window without lost samples.
    - `loud`: True if the window is loud for the learnt, and for the last good model [2].
    - `lost`: share of the payload whose loss explains the loud window (`Equations.lost`); 0 for none.
    - `left`: innovation that remains with this loss [n], N m or N.
    - `rubbed`: True if changed friction explains the loud windows.
    - `variance`: variance of a window's torque noise, (N m)² or N².
    - `duration`: time from one window to the next [s].
    """
    learnt, good, torque = trust.energy
    loud, loud_by_good = loud
    least = torque + FLOOR * FLOOR * variance
    ratio, ratio_good = jnp.max(learnt / least), jnp.max(good / least)
    since = trust.since + duration
    louder = jnp.where(loud | (trust.loud < 0.0), trust.loud + duration, jnp.maximum(trust.loud - duration, 0.0))
    unseen = ~valid & (trust.loud >= 0.0) & ((trust.loud > 0.0) | (trust.good < PROVEN))
    loud_time = jnp.where(valid, louder, jnp.where(unseen, trust.loud + duration, trust.loud))
    blind = jnp.where(unseen, trust.blind + duration, 0.0)
    # The energies remember a push for seconds, single windows do not.
    explains = (ratio_good < EXPLAINS) | ~loud_by_good
    confirmed = jnp.where(valid & explains, trust.confirmed + duration, 0.0)

    learns = trust.relearns
    done = learns & valid & certain & (ratio < EXPLAINS) & (since > ENERGY_TIME)
    worse = (ratio > WORSE * ratio_good) & (ratio > WRONG) | loud & (loud_time > CONFIRMED) & ~loud_by_good
    unproven = learns | (trust.share <= 0.0) & (since < PROBATION)
    restores = (unproven | worse) & ~done & trust.has_good & (confirmed > CONFIRMED)
    unloads = ~learns & (lost > 0.0)
    loud_time = jnp.where(unloads, -RELIEF, loud_time)
    unusual = ~learns & (loud_time > LASTING)
    rubs = unusual & rubbed & (trust.share >= 1.0) & (since > PROBATION + PROVEN)
    refines = unusual & ~rubs & ~trust.has_good & (ratio < EXPLAINS)
    changed = unusual & ~rubs & ~refines
    lasts = (since <= PROVEN) | (loud_time > LASTING)
    again = learns & ~done & ~restores & (ratio > FAILS) & (since > LASTING) & lasts
    relearns = (learns & ~done & ~restores) | changed
    settled = done | restores
    # After a change not the energy of the new model: what it has not explained yet would count as usual.
    of_model = jnp.where(restores, good, learnt)
    usual = jnp.where(restores | (done & ~trust.has_good), jnp.maximum(of_model, variance), trust.usual)
    usual = jnp.where(unloads, jnp.maximum(usual, left * left), usual)
    loud_time = jnp.where(changed | settled | rubs, 0.0, jnp.where(refines, -RELIEF, loud_time))
    fails = ~relearns & (trust.since < PROBATION) & (ratio > FAILS)
    since = jnp.where(restores | rubs, PROBATION, jnp.where(changed | done | again | fails, 0.0, since))
    uses = ~relearns & (since >= PROBATION) & (blind < BLIND)
    share = jnp.clip(trust.share + jnp.where(uses, duration / RISE, -duration / FALL), 0.0, 1.0)
    proven = jnp.where((share >= 1.0) & ~loud & ~unseen, trust.good + jnp.where(valid, duration, 0.0), 0.0)
    keeps = proven > PROVEN
    after = Trust(
        energy=trust.energy,
        rubbing=trust.rubbing,
        usual=usual,
        share=share,
        relearns=relearns,
        since=since,
        loud=loud_time,
        blind=blind,
        good=proven,
        confirmed=confirmed,
        has_good=trust.has_good | keeps,
    )
    return after, Verdict(restores, changed | again, keeps, unloads & ~restores, rubs & ~restores)


def lost_payload(
    missed: Vector, carried: Vector, heard: Bool[Array, " n"], variance: PerJoint
) -> tuple[Bool[Array, ""], Scalar, Vector]:
    """Return True if a lost share of the payload explains a window, this share, and the remaining innovation [n].

    - `missed`: innovation of the model with the whole payload [n], N m or N.
    - `carried`: torque of the whole payload [n], N m or N.
    - `heard`: True for each joint that moves in a valid window [n].
    - `variance`: variance of a window's torque noise, one number or [n], (N m)² or N².
    """
    own, torque = (jnp.where(heard, each, 0.0) for each in (missed, carried))
    # Not relative to each joint's noise: after a release the errors of the model are larger than the noise.
    size = jnp.maximum(jnp.sum(torque * torque), jnp.max(variance))
    share = jnp.clip(-jnp.sum(own * torque) / size, 0.0, 1.0)
    left = own + share * torque
    return jnp.sum(left * left) < UNEXPLAINED * jnp.sum(own * own), share, left
