"""The page's forward kinematics, run by node, against the arms' own."""

import json
import shutil
import subprocess
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from slidax.arms import couple, panda
from slidax.export.web.playground import arm_entry
from slidax.motions import ConstantPosture
from tests.arms.trees import small_tree
from tests.paper_examples import SCARA

PAGE = Path(__file__).parents[3] / "src/slidax/export/web/page"

pytestmark = pytest.mark.skipif(shutil.which("node") is None, reason="node is not installed")

SCRIPT = """
import { pathToFileURL } from "node:url";
const [page, text] = process.argv.slice(1);
const { Kinematics } = await import(pathToFileURL(`${page}/kinematics.js`));
const { arm, postures } = JSON.parse(text);
const kinematics = new Kinematics({ ...arm, up: [0, 0, 1] });
console.log(JSON.stringify(postures.map(q => kinematics.tipOf(kinematics.poses(q)))));
"""

ARMS = {"panda": panda(), "scara": SCARA, "coupled": couple(small_tree(), {"arm": ("waist", -2.0, 0.2)})}


@pytest.mark.parametrize("name", ARMS)
def test_the_page_places_the_tip_where_the_arm_has_it(name):
    robot = ARMS[name]
    still = ConstantPosture(jnp.zeros(robot.joints))
    arm = arm_entry(robot, "arm", "Arm", np.inf, np.inf, still, 1.0)
    assert arm["joints"] == robot.joints
    postures = np.random.default_rng(0).uniform(-1.0, 1.0, (5, robot.joints))
    told = json.dumps({"arm": arm, "postures": postures.tolist()})
    command = ["node", "--input-type=module", "-e", SCRIPT, str(PAGE), told]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    for q, tip in zip(postures, json.loads(done.stdout), strict=True):
        np.testing.assert_allclose(tip, robot.tip(jnp.asarray(q)), atol=1e-5)
