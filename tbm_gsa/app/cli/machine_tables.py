"""The tables of `tbm-monitor machine show` and `machine loads`."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from rich.table import Table

from tbm_dynamics.loads.description import LOAD_GROUPS
from tbm_dynamics.machine.drive import DriveBody, DriveConnection, DriveShaft, Gear
from tbm_dynamics.machine.parts import Connection
from tbm_dynamics.machine.springs import Springs
from tbm_dynamics.machine.summary import (
    BETWEEN,
    DRIVE_NODES,
    CuttingSummary,
    DriveSummary,
    GearboxSummary,
    MachineSummary,
    StageSummary,
)
from tbm_gsa.app.cli.output import add_row, narrow_table, print_sentence, results
from tbm_gsa.paper.load_summary import LoadSummary

_AXES = (">x", ">y", ">z", ">rx", ">ry", ">rz")
_DRIVE_AXES = (">x", ">r", ">t", ">rx", ">rr", ">rt")


def print_tables(summary: MachineSummary) -> None:
    """Print a summary as tables; every value with its unit and its source."""
    point, limits = summary.operating_point, summary.operating_limits
    print_sentence(f"{summary.machine}: {summary.title}")
    print_sentence(
        f"operating point {point.speed_r_min:g} r/min, {point.torque_kn_m:g} kN·m, {point.thrust_kn:g} kN "
        f"({point.source}); {summary.degrees_of_freedom} degrees of freedom, "
        f"time step {summary.time_step:g} s, settling {summary.settling:.3g} s"
    )
    if limits:
        print_sentence(
            f"limits {limits.speed_r_min:g} r/min, {limits.torque_kn_m:g} kN·m, {limits.thrust_kn:g} kN, "
            f"{limits.power_kw:g} kW ({limits.source})"
        )
    for name, source in summary.places.items():
        own = [node for node in summary.nodes if node.subsystem == name]
        rows = ((node.node, *(f"{value:g}" for value in node.place), ", ".join(node.roles)) for node in own)
        _print_table(f"nodes: {name} (places {source})", (">node", ">x, m", ">y, m", ">z, m", ""), rows)
    _print_parts(summary)
    for where in (*summary.places, BETWEEN):
        group = [item for item in summary.connections if item.where == where]
        named = ((item.name, "–".join(map(str, item.between)), item) for item in group)
        _print_connections(f"connections: {where}; N/m along and N·m/rad about", _AXES, named)
    _print_drives(summary.drives)
    _print_gears(summary.drives)
    _print_gearbox(summary.drives.gearbox)
    factors = summary.load_factors
    rows = ((group, f"{getattr(factors, group):g}", factors.source) for group in LOAD_GROUPS)
    title = f"factors on the fluctuation of the loads (log-normal, σ {factors.log_sigma:.3g}, where not known)"
    _print_table(title, ("group", ">factor", "source"), rows)
    if summary.cutters:
        _print_cutters(summary.cutters)
    masses = ((name, f"{mass / 1e3:.4g}") for name, mass in summary.masses.items())
    _print_table("masses", ("subsystem", ">t"), masses)
    _print_modes(summary)
    _print_table("numbers of the file by source", ("source", ">numbers"), summary.sources.items())


def _table(title: str, *headings: str) -> Table:
    return narrow_table(f"\n{title}", *headings)


def _print_table(title: str, headings: Iterable[str], rows: Iterable[Iterable[object]]) -> None:
    table = _table(title, *headings)
    for row in rows:
        add_row(table, *row)
    results.print(table)


def _short(value: float) -> str:
    """1e10 and 5e9 rather than 1e+10 and 5e+09."""
    return f"{value:.3g}".replace("e+0", "e").replace("e+", "e")


def _general(*values: float) -> list[str]:
    return [f"{value:g}" for value in values]


def _print_parts(summary: MachineSummary) -> None:
    shafts = (
        (
            "–".join(map(str, s.nodes)),
            *_general(s.outer_diameter, s.inner_diameter, s.mass),
            f"{s.stress / 1e6:.3g}",
            s.source,
        )
        for s in summary.shafts
    )
    _print_table("shafts", ("nodes", ">outer, m", ">inner, m", ">mass, kg", ">stress, MPa", "source"), shafts)
    bodies = ((b.node, *_general(b.mass, *b.inertia), b.source) for b in summary.bodies)
    _print_table("bodies", ("node", ">mass, kg", ">about x, kg·m²", ">about y", ">about z", "source"), bodies)


def _print_connections(
    title: str, axes: Sequence[str], named: Iterable[tuple[str, str, Connection | DriveConnection]]
) -> None:
    rows = (
        (name, between, _kind(item), *map(_short, item.stiffness_rows.diagonal()), item.source)
        for name, between, item in named
    )
    _print_table(title, ("name", "between", "type", *axes, "source"), rows)


def _kind(springs: Springs) -> str:
    """Type of a connection, and what its six stiffnesses do not show."""
    more = [*(["coupled"] if springs.stiffness_matrix else []), *(["damped"] if springs.damps else [])]
    return ", ".join((springs.type, *more))


def _print_drives(drives: DriveSummary) -> None:
    at, mount = drives.placement, drives.mount_node
    rows = [(member.drive, f"{member.angle_deg:g}", *member.nodes) for member in drives.members]
    places = ("x, m", "", *_general(at.front_seat, at.mesh, at.rear_seat, at.gearbox, at.rotor))
    headings = ("drive", ">angle, °", *(f">{node}" for node in DRIVE_NODES))
    _print_table(f"drives: {drives.count} ({drives.source})", headings, [*rows, places])
    print_sentence(
        f"{drives.radius:.4g} m off the axis (places {at.source}), "
        f"mounted on node {mount}, driving the ring gear at node {drives.ring_node}"
    )
    motor = drives.motor
    damping = f", {motor.damping:g} N·m·s/rad and {motor.stiffness:g} N·m/rad at the pinion"
    print_sentence(f"motors hold their {motor.control}{damping if motor.damping else ''} ({motor.source})")
    _print_overrides(drives)
    front, _, rear, output, rotor = drives.members[0].nodes
    between = (f"{front}, {rear}–{mount}", f"{rear}–{output}", f"{output}, {rotor}–{mount}")
    named = ((item.name, ends, item) for item, ends in zip(drives.connections, between, strict=True))
    title = "connections of drive 1; N/m along and N·m/rad about x, radial r, tangential t"
    _print_connections(title, _DRIVE_AXES, named)
    _print_table(
        "parts of a drive",
        ("part", ">outer, m", ">inner, m", ">mass, kg", ">about x, kg·m²", ">across", "source"),
        ((name, *_part_numbers(part), part.source) for name, part in drives.parts.items()),
    )


def _print_overrides(drives: DriveSummary) -> None:
    """Print how single drives differ from the template, in the words of the file."""
    rows = []
    for member in drives.members:
        drive = member.override
        if drive is None:
            continue
        stated = drive.model_dump(exclude_defaults=True, exclude={"source", "tooth"})
        values = [f"{key} {value:g}" if isinstance(value, float) else f"{key} {value}" for key, value in stated.items()]
        if drive.tooth:
            share = "" if drive.tooth.share is None else f" {drive.tooth.share:g}"
            values.append(f"tooth {drive.tooth.fault}{share}")
        rows.append((member.drive, ", ".join(values), drive.source))
    if rows:
        _print_table("drives that differ from the template", (">drive", "by", "source"), rows)


def _part_numbers(part: DriveShaft | DriveBody) -> list[str]:
    if isinstance(part, DriveShaft):
        return [*_general(part.outer_diameter, part.inner_diameter, part.mass), "", ""]
    return ["", "", *_general(part.mass, *part.inertia[:2])]


def _print_gears(drives: DriveSummary) -> None:
    gear = drives.gear
    pairs: list[tuple[str, Gear | StageSummary, str, float, float]] = [
        ("", gear, "ring/pinion", gear.contact_ratio, gear.mesh_frequency_hz)
    ]
    for number, stage in enumerate(drives.gearbox.stages, start=1):
        for pair, ratio in (("ring/planet", stage.ring_contact_ratio), ("planet/sun", stage.sun_contact_ratio)):
            pairs.append((f"stage {number} ", stage, pair, ratio, stage.mesh_frequency_hz))
    rows = (
        (
            where + pair,
            "/".join(str(getattr(gears, f"{gear}_teeth")) for gear in pair.split("/")),
            *_general(1e3 * gears.module, gears.pressure_angle_deg, 1e3 * gears.face_width),
            *(f"{contact_ratio:.3f}", f"{mesh_hz:.2f}", gears.source),
        )
        for where, gears, pair, contact_ratio, mesh_hz in pairs
    )
    headings = ("pair", "teeth", ">m, mm", ">α, °", ">b, mm", ">ε", ">mesh, Hz", "source")
    _print_table("gear pairs, from the ring to the motor", headings, rows)
    mesh = drives.mesh
    special = [f"profile shifts {' and '.join(_general(*gear.profile_shift))}"] if any(gear.profile_shift) else []
    special += [f"helix angle {gear.helix_angle_deg:g} deg"] if gear.helix_angle_deg else []
    print_sentence(
        f"mesh of {', '.join((f'{gear.ring} ring and pinion', *special))} ({mesh.source}): "
        f"{_short(mesh.mean_stiffness)} N/m, "
        f"backlash {mesh.backlash * 1e6:g} µm, damping ratio {mesh.damping_ratio:g}"
    )


def _print_gearbox(gearbox: GearboxSummary) -> None:
    rows = [
        (f"stage {number}", stage.planets, f"{stage.ratio:.4g}", _short(stage.stiffness), stage.source)
        for number, stage in enumerate(gearbox.stages, start=1)
    ]
    shafts = ("shafts", "", "", _short(gearbox.shaft_stiffness), gearbox.source)
    together = ("together", "", f"{gearbox.ratio:.4g}", _short(gearbox.stiffness), "")
    headings = ("part", ">planets", ">ratio", ">N·m/rad at the pinion", "source")
    _print_table("gearbox, from the pinion to the motor", headings, [*rows, shafts, together])
    print_sentence(f"rotor {gearbox.rotor_speed_r_min:.0f} r/min")


def _print_cutters(cutters: CuttingSummary) -> None:
    types = ((name, k.cutters, k.discs, "{:.3f} to {:.3f}".format(*k.radius)) for name, k in cutters.types.items())
    _print_table(f"cutters ({cutters.source})", ("type", ">cutters", ">discs", ">radius, m"), types)
    rock, disc = cutters.rock, cutters.disc
    print_sentence(
        f"discs {2e3 * disc.radius:g} mm across, tip {1e3 * disc.tip_width:g} mm ({disc.source}); "
        f"rock {rock.ucs_mpa:g} and {rock.bts_mpa:g} MPa ({rock.source})"
    )
    print_sentence(
        f"at the operating point {cutters.penetration_mm:.1f} mm a turn, a face disc "
        f"{cutters.normal_force_kn:.0f} and {cutters.rolling_force_kn:.1f} kN"
    )
    print_sentence(
        f"friction {cutters.friction_kn:g} kN, idle torque {cutters.idle_torque_kn_m:g} kN·m; "
        f"torque of the head {cutters.torque_kn_m:.0f} kN·m"
    )


def _print_modes(summary: MachineSummary) -> None:
    roles = {node.node: ", ".join(node.roles) for node in summary.nodes}
    rows = (
        (f"{m.frequency_hz:.2f}", m.motion, f"{m.shares[m.motion]:.0%}", f"{m.node} {roles[m.node]}")
        for m in summary.modes
    )
    _print_table("lowest natural frequencies", (">Hz", "motion", ">energy", "largest at node"), rows)


def print_loads(summary: LoadSummary) -> None:
    """Print loads beside what the paper's Table 1 or else the file states; forces in kN, moments in kN·m."""
    point = summary.operating_point
    print_sentence(
        f"{summary.machine}: cutterhead loads, {summary.loads} level, {summary.duration:g} s, seed {summary.seed}, "
        f"at {point.speed * 30.0 / math.pi:.3g} r/min, {point.torque / 1e3:.5g} kN·m, {point.thrust / 1e3:.5g} kN"
    )
    of_paper = any(row.paper_mean is not None for row in summary.components.values())
    headings = (">stated", ">mean", ">RMS", ">in regions", "stated lines", "found, Hz")
    title = f"means (magnitudes), fluctuation, beside {'Table 1 of the paper' if of_paper else 'the file'}; kN, kN·m"
    table = _table(title, "", *headings)
    for name, row in summary.components.items():
        numbers = (f"{abs(value) / 1e3:.5g}" for value in (row.stated_mean, row.mean, row.rms))
        stated = ", ".join(f"{line.stated_hz:g}" for line in row.lines)
        found = ", ".join("–" if line.found_hz is None else f"{line.found_hz:.2f}" for line in row.lines)
        add_row(table, name, *numbers, f"{row.in_regions:.0%}", stated, found)
    results.print(table)
