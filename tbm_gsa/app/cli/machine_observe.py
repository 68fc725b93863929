"""`tbm-monitor machine observe`: what the sensors on a machine can see."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated

import typer

from tbm_dynamics import Machine, load_machine
from tbm_gsa.app.cli.output import (
    DEFAULT_MACHINE,
    JSON_OPTION,
    MachineOption,
    add_row,
    narrow_table,
    print_json,
    print_sentence,
    progress_bar,
    results,
)
from tbm_gsa.app.cli.workers import Workers, anonymous_main
from tbm_gsa.explanation.observability_result import Observability, SimilarPair
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.texts import quoted
from tbm_msgs_py.base.units import STANDARD_GRAVITY

if TYPE_CHECKING:
    from tbm_gsa.explanation.observability import RunMachines, SensorChoice

ASIDE = (0.0, 1.0, 0.0)
"""From the node of a test point (m), where a sensor more is looked at by default, beside the node itself."""
LONGEST_S = 86400.0
LEAST_ERROR = 1e-3
"""Of the model: without any, band powers of one motion would hold each other to their last digit."""
_SHOWN = 5


def observe(
    machine: MachineOption = DEFAULT_MACHINE,
    points: Annotated[
        list[str] | None,
        typer.Option(
            help="Sensors: test points, separated by commas, or POINT=X,Y,Z with the offset from its node (m); can be "
            "repeated; default: all test points."
        ),
    ] = None,
    rotating: Annotated[
        list[str] | None, typer.Option(help="Test points whose sensors turn with the head; can be repeated.")
    ] = None,
    candidates: Annotated[
        list[str] | None,
        typer.Option(
            help="Places of one sensor more, as --points; default: all test points, on the node and 1 m to the left."
        ),
    ] = None,
    duration: Annotated[float, typer.Option(max=LONGEST_S, help="Length of a recording (s), 4 or more.")] = 60.0,
    noise_density: Annotated[
        float,
        typer.Option(
            min=0.0, max=10.0, help="Noise of the sensors, one-sided (m/s²/√Hz).", show_default="0.00098, 100 µg/√Hz"
        ),
    ] = 100e-6 * STANDARD_GRAVITY,
    model_error: Annotated[
        float,
        typer.Option(min=LEAST_ERROR, max=1.0, help="Relative error of a band power that the model has in any case."),
    ] = 0.05,
    workers: Workers = 2,
    json: Annotated[bool, JSON_OPTION] = False,
) -> None:
    """List the inputs and loads that sensors can see, the smallest change found, and the best additional sensor."""
    from tbm_gsa.explanation.observability import ObservationSettings, observability  # noqa: PLC0415 - loads slowly

    described = load_machine(machine)
    own, turning = tuple(described.description.test_points), rotating or []
    for point in turning:
        if point not in own:
            raise InputError(f"--rotating {quoted(point)}, allowed: {', '.join(own)}")
    sensors = _choices("--points", points or own, turning)
    if candidates is None:
        more = [one for point in own for one in (_choice(point, None, turning), _choice(point, ASIDE, turning))]
    else:
        more = _choices("--candidates", candidates, turning)
    settings = ObservationSettings(duration_s=duration, noise_density=noise_density, model_error=model_error)
    with _runs(workers) as run:
        found = observability(described, sensors, more, settings, run)
    if json:
        print_json(found)
    else:
        _print(found)


@contextmanager
def _runs(workers: int) -> Iterator[RunMachines]:
    """How the machines are computed: here, or in so many processes."""
    if workers == 1:
        yield map
        return
    from tbm_gsa.sensitivity.study.workers import local_processes, mapped  # noqa: PLC0415 - as above

    def run(function: Callable[[Machine], Array], machines: Iterable[Machine]) -> list[Array]:
        with progress_bar() as bar, anonymous_main(), local_processes(workers) as pool:
            bar.add_task("machines with an input changed", total=None)
            return mapped(pool, function, list(machines))

    yield run


def _choices(option: str, given: Sequence[str], turning: Sequence[str]) -> list[SensorChoice]:
    """Sensors that an option names."""
    found = []
    for text in given:
        point, stated, offset = text.partition("=")
        if stated:
            found.append(_choice(point.strip(), _offset(option, text, offset), turning))
        else:
            found += [_choice(name.strip(), None, turning) for name in text.split(",") if name.strip()]
    if not found:
        raise InputError(f"{option}: no test point, allowed: names, or POINT=X,Y,Z")
    return found


def _offset(option: str, text: str, offset: str) -> tuple[float, float, float]:
    try:
        x, y, z = map(float, offset.split(","))
    except ValueError:
        x, y, z = math.nan, math.nan, math.nan
    if not all(map(math.isfinite, (x, y, z))):
        raise InputError(f"{option} {quoted(text)}, allowed: POINT=X,Y,Z with three numbers (m)")
    return x, y, z


def _choice(point: str, offset: tuple[float, float, float] | None, turning: Sequence[str]) -> SensorChoice:
    from tbm_gsa.explanation.observability import SensorChoice  # noqa: PLC0415 - as above

    return SensorChoice(point, offset, "rotating" if point in turning else "fixed")


def _print(found: Observability) -> None:
    noise = found.noise_density / STANDARD_GRAVITY * 1e6
    print_sentence(
        f"{found.machine}: {', '.join(sensor.name for sensor in found.sensors)}; {found.duration:g} s, {noise:.3g} "
        f"µg/√Hz; {len(found.statistics)} band powers say something, {len(found.unused)} do not"
    )
    title = (
        f"\nSmallest changes that are found with probability {found.probability:g}, at {found.false_rate:.0%} false "
        "accusations"
    )
    table = narrow_table(title, "input", "", ">fall", ">rise", ">lost to loads")
    seen = {code: one for code, one in found.inputs.items() if one.found}
    for code, one in seen.items():
        add_row(table, code, one.name, *one.ways(), one.lost_to_loads())
    results.print(table)
    if missing := [f"{code} {one.name}" for code, one in found.inputs.items() if code not in seen]:
        print_sentence(f"not seen within their range: {', '.join(missing)}")
    if found.pairs:
        print_sentence(f"do nearly the same: {', '.join(map(_similar, found.pairs))}")
    table = narrow_table("\nfactors of the loads", "group", ">fall", ">rise")
    for group, load in found.loads.items():
        add_row(table, group, *load.ways())
    results.print(table)
    _print_candidates(found)


def _similar(pair: SimilarPair) -> str:
    """Two inputs that do nearly the same, and by what factor a change must be larger to be told."""
    names, never = " and ".join(pair.inputs), math.isnan(pair.times)
    return f"{names} (never told apart)" if never else f"{names} (told apart at {pair.times:.2g} times the table's)"


def _print_candidates(found: Observability) -> None:
    if not found.candidates:
        return
    title = (
        "\nOne sensor more: information on all inputs together, what is found then, how much smaller a change may be"
    )
    table = narrow_table(title, "place", ">bits", "found then", "smaller by")
    for one in found.candidates[:_SHOWN]:
        better = sorted(one.smaller.items(), key=lambda entry: -entry[1])[:3]
        add_row(
            table,
            one.name,
            f"{one.bits:.2f}",
            ", ".join((*one.inputs, *one.loads)) or "–",
            ", ".join(f"{code} {factor:.2f}" for code, factor in better if factor > 1.0) or "–",
        )
    results.print(table)
