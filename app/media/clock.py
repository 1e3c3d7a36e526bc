"""One clock for all streams of a video file.

The clock of a transport stream, of a joined recording or of a stream that broke off starts again, jumps or begins below
zero.  Players go on at such a place; a file with one clock needs an offset for what follows, the same for all streams.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import av
import av.error

if TYPE_CHECKING:
    from av.container import InputContainer
    from av.packet import Packet
    from av.stream import Stream

# Containers whose clock may be set anew at any time; in others, a gap is as long as it says.
_WITH_GAPS = frozenset({"mpegts", "mpeg", "ogg", "flv", "live_flv"})
_JOINABLE = _WITH_GAPS | {"matroska", "webm"}  # byte by byte; the others' times ascend by construction
_FOLLOWED = ("audio", "video")
_MAX_FAILED_READS = 64  # in a row
_ADTS_KIND = b"\xfd\xc0"  # profile, rate and channels in bytes 2 and 3 of its header (ISO/IEC 13818-7, 6.2)


@dataclass(frozen=True)
class ClockLimits:
    """What counts as a jump of the clock; seconds, unless said."""

    max_step_back: Fraction = Fraction(1, 4)
    max_step_ahead: Fraction = Fraction(10)  # as FFmpeg's `dts_delta_threshold`
    max_difference: Fraction = Fraction(1)  # between the streams' jumps at one place
    max_overlap: Fraction = Fraction(1, 4)  # of the sound before and after
    most_strays: int = 16  # packets in a row whose times are wrong


LIMITS = ClockLimits()


class ClockChange(NamedTuple):
    """What is added from a stream's packet `start` on, seconds; times below `since` are still those before."""

    start: int
    added: Fraction
    since: Fraction | None


@dataclass(frozen=True)
class FileClock:
    """What is added to the times of a file's packets.

    steps : by stream index; the first starts at packet 0.
    jumps : where the clock of the pictures jumped, seconds after it was put right.
    start, end, pictures : of the pictures, seconds and number, where the file was read for it; otherwise 0.
    small : number of jumps that nobody notices, of recordings that overlap by a few pictures.
    moved_by : how much later than the file's own it begins, seconds, see `moved`.
    varying : indices of the sounds whose rate or channels change, by the headers of their packets.
    """

    steps: Mapping[int, tuple[ClockChange, ...]] = field(default_factory=dict)
    jumps: tuple[Fraction, ...] = ()
    start: Fraction = Fraction(0)
    end: Fraction = Fraction(0)
    pictures: int = 0
    moved_by: Fraction = Fraction(0)
    small: int = 0
    varying: frozenset[int] = frozenset()

    def shift(self, index: int) -> Fraction:
        """What is added to the times of a stream's first packets, seconds."""
        return self.steps[index][0].added if index in self.steps else Fraction(0)

    def moved(self, seconds: Fraction, streams: Iterable[int]) -> FileClock:
        """The clock that counts from so many seconds later on, for streams by index."""
        still = (ClockChange(0, Fraction(0), None),)
        steps = {
            index: tuple(step._replace(added=step.added - seconds) for step in self.steps.get(index, still))
            for index in streams
        }
        return replace(
            self,
            steps=steps,
            start=self.start - seconds,
            end=self.end - seconds,
            moved_by=self.moved_by + seconds,
        )

    def note(self) -> str | None:
        """One sentence about the jumps, or None."""
        if len(self.jumps) == self.small:
            return None
        more = f" and {len(self.jumps) - 1} more" if len(self.jumps) > 1 else ""
        at = f"{float(self.jumps[0]):.2f} s{more}"
        return f"The input's clock jumps at {at}: later times were moved, so that all streams go on."


STEADY = FileClock()


class Retimer:
    """Puts the packets of one pass over a file, from its start, on the clock."""

    def __init__(self, clock: FileClock) -> None:
        self._streams = {i: _Offset(s) for i, s in clock.steps.items() if any(c.added for c in s)}

    def __call__(self, packet: Packet[Stream]) -> None:
        """Change the packet's times."""
        if (offset := self._streams.get(packet.stream_index)) is not None:
            offset.next_packet(Fraction(packet.time_base))
            if packet.pts is not None:
                packet.pts = offset.moved(packet.pts)
            if packet.dts is not None:
                packet.dts = offset.moved(packet.dts)


class _Offset:
    """What is added to one stream's times at the moment, in its unit."""

    def __init__(self, steps: tuple[ClockChange, ...]) -> None:
        self._steps, self._packets = list(steps), 0
        self._added = self._before = 0
        self._since = -math.inf

    def next_packet(self, unit: Fraction) -> None:
        """Go on to the stream's next packet."""
        while self._steps and self._steps[0].start <= self._packets:
            step = self._steps.pop(0)
            self._before, self._added = self._added, round(step.added / unit)
            self._since = -math.inf if step.since is None else math.ceil(step.since / unit)
        self._packets += 1

    def moved(self, time: int) -> int:
        """A time of that packet on the clock."""
        return time + (self._added if time >= self._since else self._before)


def clock_of(path: Path, container: InputContainer, video: Stream) -> FileClock:
    """The clock of a file, open as `container`; where it may jump, all packets are read."""
    early = _early(container, video)
    kinds = set(container.format.name.split(","))
    if not kinds & _JOINABLE or not path.is_file():
        return _shifted(container, early)
    facts = path.stat()
    return _scanned(str(path.absolute()), facts.st_size, facts.st_mtime_ns, video.index, early)


def _early(container: InputContainer, video: Stream) -> Fraction:
    """How long before zero the first packet of a file comes whose pictures begin below zero, seconds."""
    starts = [
        s.start_time * s.time_base for s in container.streams
        if s.type in _FOLLOWED and s.start_time is not None and s.time_base is not None
    ]  # fmt: skip
    below = video.start_time is not None and video.start_time < 0
    return -min(starts) if below else Fraction(0)


def _shifted(container: InputContainer, seconds: Fraction) -> FileClock:
    return (
        FileClock({s.index: (ClockChange(0, seconds, None),) for s in container.streams})
        if seconds
        else STEADY
    )


# -- finding the jumps -----------------------------------------------------------------------------------------


@dataclass(eq=False)
class _Run:
    """A stream's packets between two jumps; times in its unit, seconds.

    start : the first one's number in the stream.   step : by which its clock jumped; back by dts, ahead by pts.
    border : times below belong to the run before, as pictures are decoded in another order; None after a jump back.
    others : of the other streams at that moment, number of packets so far and last dts, seconds.
    low, high : the least and the greatest pts.
    """

    unit: Fraction
    start: int
    step: int
    border: int | None
    others: Mapping[int, tuple[int, Fraction | None]]
    low: int
    high: int

    @property
    def jump(self) -> Fraction:
        """By how much the clock jumped, seconds."""
        return self.step * self.unit

    @property
    def since(self) -> Fraction | None:
        """The border, seconds."""
        return None if self.border is None else self.border * self.unit

    @property
    def first(self) -> Fraction:
        """The least pts, seconds."""
        return self.low * self.unit

    @property
    def last(self) -> Fraction:
        """The greatest pts, seconds."""
        return self.high * self.unit

    def take(self, pts: int) -> None:
        """Add a packet's pts."""
        self.low, self.high = min(self.low, pts), max(self.high, pts)


class _Trace:
    """The runs of one stream, while its packets are read.

    is_video : whether times of a keyframe that overlap those before begin a run, as in another recording.
    is_aac : whether packets may begin with ADTS headers.   headers : those, as far as they tell rate and channels.
    overlaps : of other streams, packets with a time before that of the last one, and that time in seconds.
    """

    def __init__(self, stream: Stream, *, is_video: bool = False, is_aac: bool = False) -> None:
        self._is_video = is_video
        self._is_aac = is_aac
        self.headers: set[bytes] = set()
        self.overlaps: list[tuple[int, Fraction]] = []
        self.unit = Fraction(stream.time_base or 1)
        self.runs: list[_Run] = []
        self.packets = 0
        self._dts: int | None = None
        self._steps: Counter[int] = Counter()
        self._back = math.ceil(LIMITS.max_step_back / self.unit)
        self._ahead = math.ceil(LIMITS.max_step_ahead / self.unit)

    @property
    def step(self) -> Fraction:
        """From packet to packet as a rule, seconds."""
        return self._steps.most_common(1)[0][0] * self.unit if self._steps else Fraction(0)

    @property
    def now(self) -> Fraction | None:
        """The last dts, seconds."""
        return None if self._dts is None else self._dts * self.unit

    def feed(self, packet: Packet[Stream], traces: Mapping[int, _Trace]) -> None:
        """Take the next packet."""
        dts, pts = packet.dts, packet.pts
        least = 0 if self._is_video and packet.is_keyframe else self._back
        back = self._step_back(dts if dts is None or pts is None else min(dts, pts), least)
        if pts is not None:
            self._place(pts, back, traces)
        if self._is_aac and (begin := bytes(memoryview(packet)[:4]))[:1] == b"\xff":
            self.headers.add(bytes(one & kept for one, kept in zip(begin[2:], _ADTS_KIND, strict=True)))
        self.packets += 1

    def _step_back(self, dts: int | None, least: int) -> int:
        """By how much the dts jumps back, below 0, or 0 for not more than `least`."""
        if dts is None:
            return 0
        last, self._dts = self._dts, dts
        step = 0 if last is None else dts - last
        if step > 0:
            self._steps[step] += 1
        if step < 0 and not self._is_video:
            self.overlaps.append((self.packets, dts * self.unit))
        return step if step < -least else 0

    def _place(self, pts: int, back: int, traces: Mapping[int, _Trace]) -> None:
        """Add a pts to the last run, to the one before, or to a new one."""
        run = self.runs[-1] if self.runs else None
        if run is None or back:
            self._begin(pts, back, None, traces)
        elif pts > run.high + self._step_ahead(run):
            self._begin(pts, pts - run.high, (pts + run.high) // 2, traces)
        else:
            self.runs[-2 if run.border is not None and pts < run.border else -1].take(pts)

    def _step_ahead(self, run: _Run) -> int:
        """What counts as a jump ahead; soon after one back, also what undoes it."""
        if run.step >= -self._back or self.packets - run.start > LIMITS.most_strays:
            return self._ahead
        return min(self._ahead, max(-run.step * 3 // 4, self._back))

    def _begin(self, pts: int, step: int, border: int | None, traces: Mapping[int, _Trace]) -> None:
        others = {index: (trace.packets, trace.now) for index, trace in traces.items()}
        self.runs.append(_Run(self.unit, self.packets, step, border, others, pts, pts))


@lru_cache(maxsize=64)
def _scanned(path: str, size: int, changed: int, video: int, early: Fraction) -> FileClock:
    """The clock of a file by all its packets.

    size, changed : of the file, so that another one under its name is read again.
    """
    with av.open(path, metadata_errors="surrogateescape") as container:
        kinds = set(container.format.name.split(","))
        aac = {s.index for s in container.streams.audio if s.codec_context and s.codec_context.name == "aac"}
        traces = {
            s.index: _Trace(s, is_video=s.index == video, is_aac=s.index in aac) for s in container.streams
        }
        for packet in _packets(container):
            traces[packet.stream_index].feed(packet, traces)
        sounds = {s.index: traces[s.index] for s in container.streams.audio if traces[s.index].packets}
    if not traces[video].runs:
        return STEADY
    return _Joined(traces, video, sounds, early, closes_gaps=bool(kinds & _WITH_GAPS)).clock()


def _packets(container: InputContainer) -> Iterator[Packet[Stream]]:
    """All packets that can be read, without those that end a stream."""
    failures = 0
    while failures < _MAX_FAILED_READS:
        try:
            for packet in container.demux():
                failures = 0
                if packet.size:
                    yield packet
            return
        except av.error.FFmpegError:
            failures += 1


class _Joined:
    """Joins the runs of a file: each run of the pictures follows the one before."""

    def __init__(
        self, traces: Mapping[int, _Trace], video: int, sounds: Mapping[int, _Trace], early: Fraction,
        *, closes_gaps: bool,
    ) -> None:  # fmt: skip
        self._video, self._index, self._sounds = traces[video], video, sounds
        self._closes_gaps = closes_gaps
        self._varying = frozenset(index for index, sound in sounds.items() if len(sound.headers) > 1)
        self._steps = {index: [ClockChange(0, early, None)] for index in traces}
        self._next_run = dict.fromkeys(sounds, 1)

    def clock(self) -> FileClock:
        """The clock that joins all runs."""
        runs, jumps, small = self._video.runs, [], 0
        for before, run in pairwise(runs):
            if (followers := self._followers(before, run)) is not None:
                added = self._added(before, run, followers)
                self._steps[self._index].append(ClockChange(run.start, added, run.since))
                for index, (start, sound) in followers.items():
                    self._steps[index].append(ClockChange(start, added, sound.since if sound else None))
                jumps.append(run.first + added)
                small += -LIMITS.max_step_back <= run.jump < 0
        own = self._steps[self._index]
        return FileClock(
            {index: tuple(steps) for index, steps in self._steps.items()}, tuple(jumps),
            runs[0].first + own[0].added, runs[-1].last + self._video.step + own[-1].added, self._video.packets,
            small=small, varying=self._varying,
        )  # fmt: skip

    def _followers(self, before: _Run, run: _Run) -> dict[int, tuple[int, _Run | None]] | None:
        """The other streams that jump with the pictures' run: from which packet, in which run; None for no jump."""
        found: dict[int, tuple[int, _Run | None]] = {}
        if -LIMITS.max_step_back <= run.jump < 0:
            return self._overlapping(run)
        for index in self._sounds:
            if (same := self._same_jump(index, run)) is not None:
                found[index] = same.start, same
        together = all(index in found or self._is_away(index, run) for index in self._sounds)
        if not together and self._strays(run):
            return {}
        if run.jump > 0 and not (together and self._closes_gaps):
            return None  # pictures that are missing, or stand still, while the sound goes on
        for index, (packets, now) in run.others.items():
            if index not in (self._index, *found) and (
                index not in self._sounds
                or now is None
                or abs(now - run.first) < abs(now - before.last)  # it ended early enough not to jump itself
            ):
                found[index] = packets, None
        return found

    def _overlapping(self, run: _Run) -> dict[int, tuple[int, _Run | None]] | None:
        """As `_followers`, for pictures that step back a little: another recording where all sounds overlap, too."""
        found: dict[int, tuple[int, _Run | None]] = {
            index: (packets, None) for index, (packets, _) in run.others.items() if index != self._index
        }
        for index, trace in self._sounds.items():
            near = [start for start, time in trace.overlaps if abs(time - run.first) < LIMITS.max_difference]
            if not near and not self._is_away(index, run):
                return None
            found[index] = near[0] if near else found[index][0], None
        return found

    def _is_away(self, index: int, run: _Run) -> bool:
        """Whether a sound has ended before the run, or not begun."""
        packets, now = run.others[index]
        return now is None or packets == self._sounds[index].packets

    def _same_jump(self, index: int, run: _Run) -> _Run | None:
        """The run of a sound that jumps as far as that of the pictures."""
        runs = self._sounds[index].runs
        for number in range(self._next_run[index], len(runs)):
            if abs(runs[number].jump - run.jump) < LIMITS.max_difference:
                self._next_run[index] = number + 1
                return runs[number]
        return None

    def _strays(self, run: _Run) -> bool:
        """Whether the pictures alone jump and jump back: a few wrong times."""
        pairs = pairwise(self._video.runs[1:])
        return any(run in (a, b) and abs(a.jump + b.jump) < LIMITS.max_difference for a, b in pairs)

    def _added(self, before: _Run, run: _Run, followers: Mapping[int, tuple[int, _Run | None]]) -> Fraction:
        """What the run's times need: its pictures follow those before, unless its sound would overlap too much."""
        added = self._steps[self._index][-1].added + before.last + self._video.step - run.first
        for index, (_, sound) in followers.items():
            if sound is not None:
                trace = self._sounds[index]
                end = trace.runs[trace.runs.index(sound) - 1].last + trace.step + self._steps[index][-1].added
                added = max(added, end - LIMITS.max_overlap - sound.first)
        return added
