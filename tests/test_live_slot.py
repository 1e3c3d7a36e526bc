"""The place between two threads."""

import threading

from guise.app.live.slot import LatestSlot


def test_the_latest_wins_and_the_others_are_counted() -> None:
    slot: LatestSlot[int] = LatestSlot()
    for number in range(5):
        slot.put(number)
    assert slot.get() == 4
    assert slot.dropped == 4
    assert slot.get(timeout=0) is None


def test_without_loss_every_item_arrives_in_order() -> None:
    slot: LatestSlot[int] = LatestSlot(lossless=True)

    def fill() -> None:
        for number in range(200):
            slot.put(number)
        slot.close()

    thread = threading.Thread(target=fill)
    thread.start()
    seen = []
    while (item := slot.get()) is not None:
        seen.append(item)
    thread.join()
    assert seen == list(range(200))
    assert slot.dropped == 0


def test_closing_wakes_who_waits_and_keeps_what_lies_there() -> None:
    slot: LatestSlot[int] = LatestSlot()
    threading.Timer(0.05, slot.close).start()
    assert slot.get() is None
    other: LatestSlot[int] = LatestSlot(lossless=True)
    other.put(1)
    threading.Timer(0.05, other.close).start()
    other.put(2)  # waits for room that never comes
    assert other.get() == 1
    assert other.get() is None
