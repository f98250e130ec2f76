from types import SimpleNamespace

import numpy as np
import pytest

from slidax.runtime import KEPT_ROWS, STOP, LoopJob, Mailbox, MemoryLayout, Ring, now, processes

FORTH, BACK, ROW = 24 + 24, 8 + 8, 16


class Still:
    def __init__(self, *_):
        self.tau, self.row, self.measured = np.zeros(1), np.zeros(ROW, np.uint8), np.zeros(24, np.uint8)
        self.braking, self.rests, self.came = False, True, []
        self.arena = SimpleNamespace(view=lambda name: np.zeros(()))
        COMMANDS.append(self.came)

    def set(self, k, came):
        self.came.append((k, came, self.braking))

    def measure(self, k):
        return True

    def move(self):
        return True


COMMANDS = []


def work(monkeypatch, number, sent):
    monkeypatch.setattr(processes, "ArmSide", Still)
    sizes = np.cumsum(
        [0, Mailbox.size(FORTH), Mailbox.size(BACK), Ring.size(ROW, KEPT_ROWS), Ring.size(ROW, KEPT_ROWS)]
    )
    memory = np.zeros(sizes[-1] + 16, np.uint8)
    job = LoopJob(None, MemoryLayout(*sizes.tolist(), 0), (FORTH, BACK, ROW, ROW), 1e-3, 25, 20, 0, 0, None, 1)
    start = now() + 5_000_000

    def started():
        box = Mailbox(memory[sizes[1] :], BACK)
        box.message[:8].view("i8")[0] = STOP if sent is None else start + sent
        box.put(number)
        return start

    stage = SimpleNamespace(
        at=lambda offset: memory[offset:], ready=lambda: None, started=started, stops=False, report=lambda *text: text
    )
    return *processes.run_arm(job, stage), COMMANDS[-1]


@pytest.mark.parametrize(("number", "late", "taken"), [(0, -1_000_000, 0), (0, 1_000_000, None), (1, -1, 1)])
def test_a_command_is_used_at_its_tick_only_if_sent_before_that_tick(monkeypatch, number, late, taken):
    reason, counts, came = work(monkeypatch, number, late)
    assert [k for k, it_came, _ in came if it_came] == ([] if taken is None else [taken])
    # After 20 ticks without a command the arm brakes, and the loop ends when the arm is at rest.
    ticks = 21 if taken is None else taken + 22
    assert [braking for _, _, braking in came] == [False] * (ticks - 1) + [True]
    assert (reason, counts["ticks"], counts["held"]) == ("no command", ticks, ticks - (taken is not None))


def test_arm_brakes_at_the_first_tick_with_a_stop_request(monkeypatch):
    reason, counts, came = work(monkeypatch, 0, None)
    assert came == [(0, False, True)]
    assert (reason, counts["ticks"], counts["held"]) == ("stop requested", 1, 0)
