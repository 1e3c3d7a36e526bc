"""The queue between two threads."""

import threading

from guise.common.channel import Channel


def test_the_latest_wins_and_the_others_are_counted() -> None:
    channel: Channel[int] = Channel(latest=True)
    for number in range(5):
        channel.put(number)
    assert channel.get() == 4
    assert channel.dropped == 4
    assert channel.get(timeout=0) is None


def test_without_loss_every_item_arrives_in_order() -> None:
    channel: Channel[int] = Channel()

    def fill() -> None:
        for number in range(200):
            channel.put(number)
        channel.close()

    thread = threading.Thread(target=fill)
    thread.start()
    seen = []
    while (item := channel.get()) is not None:
        seen.append(item)
    thread.join()
    assert seen == list(range(200))
    assert channel.dropped == 0


def test_closing_wakes_who_waits_and_keeps_what_lies_there() -> None:
    channel: Channel[int] = Channel(latest=True)
    threading.Timer(0.05, channel.close).start()
    assert channel.get() is None
    other: Channel[int] = Channel()
    other.put(1)
    threading.Timer(0.05, other.close).start()
    other.put(2)  # waits for room that never comes
    assert other.get() == 1
    assert other.get() is None


def test_a_cancelled_channel_holds_nothing_and_takes_nothing() -> None:
    channel: Channel[int] = Channel(2)
    assert channel.put(1)
    channel.close(discard=True)
    assert not channel.put(2)
    assert channel.get() is None
