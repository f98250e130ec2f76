"""The script that shows a job, run by node with elements that only keep their text."""

import json
import shutil
import subprocess
from pathlib import Path

import pytest

CARD = Path(__file__).parents[2] / "src/slidax/studio/page/job-card.js"

pytestmark = pytest.mark.skipif(shutil.which("node") is None, reason="node is not installed")

SCRIPT = """
class Node {
  constructor(text) { this.own = text ?? ""; this.children = []; this.hidden = false; this.open = false; }
  set textContent(text) { this.own = text; this.children = []; }
  get textContent() { return this.own + this.children.map(child => child.textContent ?? String(child)).join(""); }
  replaceChildren(...children) { this.children = children; }
  addEventListener() {}
}
const element = (tag, { text } = {}, ...children) => {
  const node = new Node(text);
  node.children = children.flat().filter(child => child !== null && child !== undefined && child !== false);
  return node;
};
const job = JSON.parse(process.argv[1]);
globalThis.studioParts = { values: async () => job, element, button: text => new Node(text) };
(0, eval)(require("fs").readFileSync(process.argv[2], "utf8"));
const card = studioParts.jobCard("1", { renew: async () => {}, say: () => {} });
card.show(job).then(() => console.log(card.place.textContent));
"""


def shown(job):
    done = subprocess.run(
        ["node", "-e", SCRIPT, json.dumps(job), str(CARD)], capture_output=True, text=True, timeout=60, check=True
    )
    return done.stdout


def test_a_certificate_that_does_not_hold_is_shown_with_its_remedies_and_their_settings():
    failing = {"name": "contraction", "holds": False, "since": None, "grade": None, "statement": "It grows."}
    failing["remedy"] = [
        {"words": "allow more torque", "set": {"actuator.torque": [30, 40]}},
        {"words": "slow the motion down", "set": {}},
    ]
    answer = {"certificates": [failing, {**failing, "name": "gains", "holds": True, "grade": "B", "remedy": []}]}
    job = {"state": "done", "code": 4, "meaning": "", "command": "slidax certify x", "seconds": 1.0, "rows": None}
    text = shown({**job, "kind": "certify", "answer": answer, "links": [], "log": ""})
    assert "allow more torque actuator.torque=[30,40]" in text and "slow the motion down" in text
    assert "gains, grade B" in text
    assert "[object Object]" not in text and "undefined" not in text
