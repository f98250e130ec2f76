import os

import numpy as np

from slidax.runtime import Mailbox, Ring, Sleeper, create_shared_memory, map_shared_memory, now


def shared(size):
    descriptor = create_shared_memory(size)
    sides = map_shared_memory(descriptor), map_shared_memory(descriptor)
    os.close(descriptor)
    return sides


def test_mailbox_returns_the_newest_complete_message_and_its_number():
    here, there = (Mailbox(memory, 24) for memory in shared(Mailbox.size(24)))
    here.clear()
    assert there.get() == -2
    for number in range(-1, 30):
        here.message[:] = number + 1
        here.put(number)
        assert there.get() == number and (there.message == number + 1).all()


def test_mailbox_ignores_a_message_that_is_being_written():
    memory, other = shared(Mailbox.size(24))
    here, there = Mailbox(memory, 24), Mailbox(other, 24)
    here.clear()
    here.message[:] = 3
    here.put(4)
    row = memory[8:].reshape(8, 40)[4]
    row[20] ^= 1
    assert there.get() == -2
    row[20] ^= 1
    assert there.get() == 4
    # Another number for this place does not fit the body.
    row[:8].view(np.int64)[0] = 12
    assert there.get() == -2


def test_ring_delivers_each_row_once_and_counts_lost_rows():
    here, there = (Ring(memory, 8, 256) for memory in shared(Ring.size(8, 256)))
    numbers = []
    for number in range(150):
        here.put(np.array([number]).view(np.uint8))
        if number % 37 == 0:
            numbers += there.take().view(np.int64).ravel().tolist()
    numbers += there.take(last=True).view(np.int64).ravel().tolist()
    assert numbers == list(range(150)) and there.lost == 0
    for number in range(150, 650):
        here.put(np.array([number]).view(np.uint8))
    late = there.take(last=True).view(np.int64).ravel().tolist()
    assert late == list(range(650 - len(late), 650)) and there.lost == 500 - len(late) > 0


def test_sleeper_never_wakes_up_early():
    sleeper = Sleeper()
    for wait in (0, 100_000, 2_000_000):
        due = now() + wait
        sleeper.until(due)
        assert now() >= due
    before = now()
    sleeper.until(before - 1_000_000_000)
    assert now() - before < 500_000_000
