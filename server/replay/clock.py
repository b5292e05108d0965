"""Where the time of a replay goes."""

from __future__ import annotations

from dataclasses import dataclass

from server.replay.contract import TimingOut


@dataclass(slots=True)
class Clock:
    """Seconds spent on each part of the work."""

    read_s: float = 0.0
    engine_s: float = 0.0
    finish_s: float = 0.0
    score_s: float = 0.0
    write_s: float = 0.0

    def timing(self, total_s: float, samples: int, duration_s: float) -> TimingOut:
        """Return the account; rates are None when the engine had nothing to do."""
        busy = self.engine_s > 0.0 and samples > 0
        return TimingOut(
            read_s=self.read_s,
            engine_s=self.engine_s,
            finish_s=self.finish_s,
            score_s=self.score_s,
            write_s=self.write_s,
            total_s=total_s,
            samples_per_s=samples / self.engine_s if busy else None,
            real_time_factor=duration_s / self.engine_s if busy else None,
        )
