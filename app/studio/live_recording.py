"""Recordings and snapshots of the page Live: the browser's sound comes only while one is made."""

from __future__ import annotations

import asyncio
import time
from pathlib import Path

from nicegui import ui

from guise.app.studio.frame_socket import Peer
from guise.app.studio.live_run import LiveRun

LISTEN_SECONDS = 5.0  # that the browser gets to begin with its sound


class RecordingButtons:
    """Buttons that record a run, and its downloads."""

    def __init__(self) -> None:
        self._run: LiveRun | None = None
        self._peer: Peer | None = None
        self._toggling = False  # a recording is being started or stopped
        self._downloaded: set[Path] = set()
        self._record = ui.button("Record", icon="fiber_manual_record", on_click=self.toggle).props("outline")
        self._snap = ui.button("Snapshot", icon="photo_camera", on_click=self.snapshot).props("outline")

    def of(self, run: LiveRun | None, peer: Peer | None) -> None:
        """Record this run from now on; None is none.   peer : whose sound is recorded."""
        self._run, self._peer = run, peer
        for button in (self._record, self._snap):
            button.set_enabled(run is not None)

    async def toggle(self) -> None:
        """Start or stop a recording, once whatever is pressed meanwhile."""
        if (run := self._run) is None or self._toggling:
            return
        self._toggling = True
        try:
            if not run.recording:
                await self._listen(run)
                run.toggle_recording()
            else:
                run.toggle_recording()
                await ui.run_javascript("return await guiseLive.deafen()", timeout=LISTEN_SECONDS)
        finally:
            self._toggling = False

    async def snapshot(self) -> None:
        """Download the last frame."""
        if self._run is not None and (path := await asyncio.to_thread(self._run.snapshot)) is not None:
            ui.download.file(path)

    def report(self, run: LiveRun) -> None:
        """Show a run's messages, and download its recordings that are complete."""
        self._record.text = "Stop recording" if run.recording else "Record"
        while not run.notes.empty():
            ui.notify(run.notes.get())
        for path in run.recorded():
            if path not in self._downloaded:
                self._downloaded.add(path)
                ui.download.file(path)

    async def _listen(self, run: LiveRun) -> None:
        """Have the browser send its sound, and wait for it: a recording that begins without has no sound at all."""
        begun = time.monotonic()
        if not await ui.run_javascript("return await guiseLive.listen()", timeout=LISTEN_SECONDS):
            return
        while run.running and self._peer is not None and not self._peer.microphone.is_on:
            if time.monotonic() > begun + LISTEN_SECONDS:
                ui.notify("This recording has no sound: the microphone gives none.")
                return
            await asyncio.sleep(0.02)
