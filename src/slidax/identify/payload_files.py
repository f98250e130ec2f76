"""Payloads in the formats of robot manufacturers."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from slidax.arms.arm import Payload
from slidax.core.errors import DefinitionError, nearest_word


def urscript_payload(payload: Payload) -> str:
    """Return a line of URScript: mass, centre, and inertia about the centre as xx, yy, zz, xy, xz, yz."""
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = np.asarray(payload.inertia).tolist()
    return f"set_target_payload({float(payload.mass):.6g}, {_list(payload.center)}, {_list([xx, yy, zz, xy, xz, yz])})"


def libfranka_payload(payload: Payload) -> str:
    """Return a call of libfranka: mass, centre in the flange's frame, and inertia about the centre, column-major."""
    inertia = np.asarray(payload.inertia).T.ravel()
    center, entries = (_list(values).replace("[", "{").replace("]", "}") for values in (payload.center, inertia))
    return f"robot.setLoad({float(payload.mass):.6g}, {center}, {entries});"


def desk_payload(payload: Payload) -> str:
    """Return an end-effector file for Franka Desk: as `libfranka_payload`, with the tool's frame at the flange."""
    return json.dumps(
        {
            "mass": float(f"{float(payload.mass):.6g}"),
            "centerOfMass": _numbers(payload.center),
            "transformation": _numbers(np.eye(4)),
            "inertia": _numbers(np.asarray(payload.inertia).T),
        }
    )


def kuka_payload(payload: Payload) -> str:
    """Return the load of tool 1 in KUKA's KRL: mass, centre in mm, and inertia about its principal axes.

    A, B and C are the angles of successive rotations about Z, Y and X to the principal axes, in degrees.
    """
    moments, axes = np.linalg.eigh(np.asarray(payload.inertia))
    axes[:, 0] *= np.linalg.det(axes)
    angles = Rotation.from_matrix(axes).as_euler("ZYX", degrees=True)
    center = [*(1e3 * np.asarray(payload.center)), *angles]
    frame = ",".join(f"{name} {value:.6g}" for name, value in zip("XYZABC", center, strict=True))
    inertia = ",".join(f"{name} {value:.6g}" for name, value in zip("XYZ", moments, strict=True))
    return f"LOAD_DATA[1]={{M {float(payload.mass):.6g},CM {{{frame}}},J {{{inertia}}}}}"


def urdf_payload(payload: Payload) -> str:
    """Return a URDF link with the payload's inertia, to be fixed to the tip."""
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = np.asarray(payload.inertia).tolist()
    names = {"ixx": xx, "ixy": xy, "ixz": xz, "iyy": yy, "iyz": yz, "izz": zz}
    entries = " ".join(f'{name}="{value:.6g}"' for name, value in names.items())
    center = " ".join(f"{value:.6g}" for value in np.asarray(payload.center).tolist())
    return (
        f'<link name="payload"><inertial><origin xyz="{center}"/><mass value="{float(payload.mass):.6g}"/>'
        f"<inertia {entries}/></inertial></link>"
    )


FORMS: Mapping[str, Callable[[Payload], str]] = {
    "ur": urscript_payload,
    "franka": libfranka_payload,
    "desk": desk_payload,
    "kuka": kuka_payload,
    "urdf": urdf_payload,
}
"""Names of the manufacturers' formats, and the functions that write a payload in them."""


def require_payload_form(form: str) -> None:
    """Raise DefinitionError if `form` is not the name of a format in `FORMS`."""
    if form not in FORMS:
        raise DefinitionError(f"unknown payload format `{form}`; {nearest_word(form, FORMS)}")


def payload_text(payload: Payload, form: str) -> str:
    """Return a payload as text in a manufacturer's format.

    The payload's frame is the arm's tip, which must be the manufacturer's flange.

    - `form`: name of the format, one of `FORMS`.

    Raises DefinitionError for an unknown format.
    """
    require_payload_form(form)
    return FORMS[form](payload)


def _numbers(values: object) -> list[float]:
    return [float(f"{value:.6g}") for value in np.asarray(values, float).ravel().tolist()]


def _list(values: object) -> str:
    return "[" + ", ".join(f"{value:.6g}" for value in np.asarray(values, float).tolist()) + "]"
