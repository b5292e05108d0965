"""`navdeck compare LOG`: one run, every lane's figures, and what is needed to draw them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from server.compare.contract import CompareOut, LaneOut, WindowOut
from server.compare.cost import Costs, measure
from server.compare.figures import OPEN_NS, LaneData, Window, figures, lanes_of
from server.compare.flight import Flight, Flown, fly, has_reference
from server.compare.options import Options
from server.magnetic import wmm_field
from server.nav.types import EngineSettings, Kind
from server.replay import summary as build
from server.replay.options import idle_values, merged
from server.replay.run import EngineFactory, nav_engine
from server.replay.source import BLOCK_ROWS, LogInput, load

WHOLE, SETTLED = "whole", "settled"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Comparison:
    """The figures, and the curves behind them.

    Attributes:
        lanes: by the same names as `out.lanes`.
        t_origin_ns: of the windows and of the plots' time axes.
    """

    out: CompareOut
    lanes: Mapping[str, LaneData]
    t_origin_ns: int


def compare_log(
    log: Path,
    options: Options,
    *,
    progress: Callable[[float], None] | None = None,
    engine_factory: EngineFactory = nav_engine,
    with_cost: bool = True,
) -> Comparison:
    """Run a log once with all lanes and compare them.

    Args:
        log: a .tlog or a sensor folder.
        options: checked.
        progress: told the share done, 0 to 1.
        engine_factory: builds the engine.
        with_cost: measure what a step costs, which runs the log's beginning some more times.

    Raises:
        ReplayError: the log or an option is not usable; the message names the remedy.
    """
    source = load(log)
    settings = _settings(source, options)
    engine = engine_factory(settings, wmm_field)
    flown = fly(source.blocks(BLOCK_ROWS), engine, fraction=source.fraction, progress=progress)
    costs = measure(flown.excerpt, settings, wmm_field) if with_cost else Costs()
    reference = options.reference or _reference_of(flown)
    shown = tuple(dict.fromkeys((*options.lanes, options.chosen, *([reference] if reference else []))))
    lanes = {
        build.stem(name, place): data
        for place, flight in enumerate(flown.flights)
        for name, data in lanes_of(flight, shown, options.chosen, reference).items()
    }
    out = _account(source, settings, options, flown, costs, lanes, reference)
    return Comparison(out=out, lanes=lanes, t_origin_ns=max(source.t_origin_ns, 0))


def _settings(source: LogInput, options: Options) -> EngineSettings:
    chosen = {} if options.nav_rate_hz is None else {"nav_rate_hz": options.nav_rate_hz}
    told = {
        "lanes": options.running,
        "lane_parameters": options.parameters,
        "gnss_withheld_s": options.gnss_outages,
        "t_origin_ns": source.t_origin_ns,
    }
    return merged(source.overrides, chosen, told)


def _reference_of(flown: Flown) -> str | None:
    """Return the better source there is: the log's reference, else the board's own solution."""
    if has_reference(flown):
        return "reference"
    return "onboard" if any(flight.boot.samples[Kind.ONBOARD] for flight in flown.flights) else None


def windows_of(flight: Flight, options: Options, t_origin_ns: int) -> dict[str, Window]:
    """Return the windows of one power-up by name, in board time."""
    out = {WHOLE: (-OPEN_NS, OPEN_NS)}
    if flight.boot.t_fix_ns >= 0:
        out[SETTLED] = (flight.boot.t_fix_ns + build.SETTLING_NS, OPEN_NS)
    for start_s, stop_s in options.windows:
        out[f"{start_s:g}:{stop_s:g}"] = (t_origin_ns + round(start_s * 1e9), t_origin_ns + round(stop_s * 1e9))
    return out


def _account(
    source: LogInput,
    settings: EngineSettings,
    options: Options,
    flown: Flown,
    costs: Costs,
    lanes: Mapping[str, LaneData],
    reference: str | None,
) -> CompareOut:
    boots = [flight.boot for flight in flown.flights]
    origin_ns = max(source.t_origin_ns, 0)
    out: dict[str, LaneOut] = {}
    for stem, data in lanes.items():
        name, _, place = stem.partition(".boot")
        flight = flown.flights[int(place or 0)]
        out[stem] = _lane(name, flight, data, costs, settings, windows_of(flight, options, origin_ns))
    first = windows_of(flown.flights[0], options, origin_ns)
    return CompareOut(
        navdeck_version=build.navdeck_version(),
        log=build.log_out(source, boots),
        settings=build.settings_out(settings),
        chosen=options.chosen,
        reference=reference,
        windows={name: _window(window, origin_ns) for name, window in first.items()},
        engine_ns_per_step=costs.engine_ns_per_step,
        lanes=out,
        notes=[
            *source.account().notes,
            *idle_values(settings.lane_parameters, settings.lanes),
            *build.date_notes(settings, boots),
            *_notes(out, reference),
        ],
    )


def _lane(
    name: str,
    flight: Flight,
    data: LaneData,
    costs: Costs,
    settings: EngineSettings,
    windows: Mapping[str, Window],
) -> LaneOut:
    from server.nav.lanes.registry import defaults_of, provides_of

    values = defaults_of(name) | dict(settings.lane_parameters.get(name, {}))
    return LaneOut(
        lane=name,
        boot_id=flight.boot.boot_id,
        provides=provides_of(name),
        parameters={parameter: build.known(value) for parameter, value in values.items()},
        failure=flight.boot.failure(name),
        compared_at=data.error.stamps if data.error is not None else None,
        cost=costs.lanes.get(name),
        windows={window: figures(data, span) for window, span in windows.items()},
    )


def _window(window: Window, origin_ns: int) -> WindowOut:
    start_ns, stop_ns = window
    return WindowOut(
        from_s=(start_ns - origin_ns) * 1e-9 if start_ns > -OPEN_NS else None,
        to_s=(stop_ns - origin_ns) * 1e-9 if stop_ns < OPEN_NS else None,
    )


def _notes(lanes: Mapping[str, LaneOut], reference: str | None) -> list[str]:
    notes = [f"{name}: put aside; {lane.failure}" for name, lane in lanes.items() if lane.failure]
    notes += [f"{name}: no row; the log has nothing it could work on." for name, lane in lanes.items() if _empty(lane)]
    if reference is None:
        notes.append("The log has neither a reference nor the board's own solution: no errors, no delays.")
    elif reference == "onboard":
        notes.append("Errors are against the board's own solution, which is itself an estimate.")
    return notes


def _empty(lane: LaneOut) -> bool:
    return not lane.windows[WHOLE].rows
