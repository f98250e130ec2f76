"""Path tricks that ask for a file outside the studio's folder, and a folder to try them in."""

import os

SECRET = "planted-secret-7f3a9"

ROBOT = f"""<?xml version="1.0"?>
<mujoco model="{SECRET}"><worldbody><body name="b"><joint name="j" axis="0 0 1"/>
<inertial pos="0 0 0.1" mass="1" diaginertia="0.1 0.1 0.1"/></body></worldbody></mujoco>
"""


def planted(top):
    outside, root = top / "outside", top / "root"
    for place in (outside, root / "sub"):
        place.mkdir(parents=True)
    for ending in ("yaml", "csv", "json", "mcap"):
        (outside / f"secret.{ending}").write_text(f"title: {SECRET}\nrobot: {{kind: {SECRET}}}\n", encoding="utf-8")
    (outside / "secret.urdf").write_text(ROBOT, encoding="utf-8")
    (outside / "secret.xml").write_text(ROBOT, encoding="utf-8")
    (root / "own.yaml").write_text("title: own\n", encoding="utf-8")
    for name, target in {
        "link.yaml": "../outside/secret.yaml",
        "absolute.yaml": str(outside / "secret.yaml"),
        "folder": "../outside",
        "sub/up": "../..",
        "twice.yaml": "link.yaml",
        "self": ".",
        "round.yaml": "round.yaml",
        "proc": "/proc/self",
        "top": "/",
    }.items():
        os.symlink(target, root / name)
    return root


def tricks(root):
    secret = root.parent / "outside" / "secret.yaml"
    up = "../outside/secret.yaml"
    return [
        *(up, f"./{up}", f"sub/../{up}", "sub/../../outside/secret.yaml/", "sub/../../outside/./secret.yaml"),
        *("..//outside//secret.yaml", "....//outside/secret.yaml", "...//../outside/secret.yaml", f"nowhere/../{up}"),
        *(str(secret), f"/{secret}", f"//{str(secret).lstrip('/')}", f"file://{secret}", f"file:{secret}"),
        *(f"~/../..{secret}", "~root/secret.yaml", "link.yaml", "absolute.yaml", "twice.yaml", "folder/secret.yaml"),
        *("sub/up/outside/secret.yaml", "sub/up/root/../outside/secret.yaml", "self/link.yaml"),
        *("self/self/folder/secret.yaml", f"top/{str(secret).lstrip('/')}", f"proc/cwd/{up}", f"proc/root{secret}"),
        *(f"/proc/self/root{secret}", f"/proc/self/cwd/{up}", f"/dev/fd/../../{str(secret).lstrip('/')}"),
        *("round.yaml", "%2e%2e/outside/secret.yaml", "%2e%2e%2foutside%2fsecret.yaml"),
        *("..%252foutside%252fsecret.yaml", "..%c0%afoutside%c0%afsecret.yaml", "\uff0e\uff0e/outside/secret.yaml"),
        *("..\\outside\\secret.yaml", "sub\\..\\..\\outside\\secret.yaml", f"C:\\{secret.name}"),
        *("\\\\?\\C:\\outside\\secret.yaml", "//server/outside/secret.yaml", "own.yaml\0/../../outside/secret.yaml"),
        *("../outside/secret.yaml\0.yaml", "own.yaml::$DATA", "../outside/secret.yaml ", "../outside/secret.yaml."),
        *("CON.yaml", "\n../outside/secret.yaml", "-o../outside/secret.yaml", "--out=../outside/secret.yaml"),
    ]


def state_of(place):
    return {str(path): path.read_bytes() for path in sorted(place.rglob("*")) if path.is_file()}
