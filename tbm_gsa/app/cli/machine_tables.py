"""The tables of `tbm-monitor machine show` and `machine loads`."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from rich.table import Table

from tbm_dynamics.loads.cutters.description import CutterDescription
from tbm_dynamics.machine.description import Connection, Subsystem
from tbm_dynamics.machine.drive import DriveConnection, DriveTemplate, Gear
from tbm_dynamics.machine.summary import (
    BETWEEN,
    DRIVE_CONNECTIONS,
    DRIVE_NODES,
    DRIVE_PARTS,
    CuttingSummary,
    MachineSummary,
    structures_of,
)
from tbm_dynamics.mesh.planetary import PlanetaryStage
from tbm_dynamics.structure.drive import drive_angles, drive_nodes, gear_pair
from tbm_gsa.app.cli.output import add_row, narrow_table, print_sentence, results

_AXES = (">x", ">y", ">z", ">rx", ">ry", ">rz")
_DRIVE_AXES = (">x", ">r", ">t", ">rx", ">rr", ">rt")


def print_tables(summary: MachineSummary) -> None:
    """Print a summary as tables; every value with its unit and its source."""
    description = summary.machine.description
    point, limits = description.operating_point, description.operating_limits
    print_sentence(f"{summary.machine.name}: {description.title}")
    print_sentence(
        f"operating point {point.speed_r_min:g} r/min, {point.torque_kn_m:g} kN·m, {point.thrust_kn:g} kN "
        f"({point.source}); {summary.degrees_of_freedom} degrees of freedom"
    )
    if limits:
        print_sentence(
            f"limits {limits.speed_r_min:g} r/min, {limits.torque_kn_m:g} kN·m, {limits.thrust_kn:g} kN, "
            f"{limits.power_kw:g} kW ({limits.source})"
        )
    structures = structures_of(description)
    for name, part in structures:
        table = _table(f"nodes: {name} (places {part.source})", ">node", ">x, m", ">y, m", ">z, m", "")
        for node in (node for node in summary.nodes if node.subsystem == name):
            add_row(table, node.node, *(f"{value:g}" for value in node.place), ", ".join(node.roles))
        results.print(table)
    _print_parts([part for _, part in structures])
    for where, group in (*((name, part.connections) for name, part in structures), (BETWEEN, description.connections)):
        rows = ((item.name, "–".join(map(str, item.between)), item) for item in group)
        _print_connections(f"connections: {where}; N/m along and N·m/rad about", _AXES, rows)
    _print_drives(description.driveshaft)
    _print_gears(summary)
    _print_gearbox(summary)
    if description.cutters and summary.cutting:
        _print_cutters(description.cutters, summary.cutting)
    table = _table("masses", "subsystem", ">t")
    for name, mass in summary.masses.items():
        add_row(table, name, f"{mass / 1e3:.1f}")
    results.print(table)
    _print_modes(summary)
    table = _table("numbers of the file by source", "source", ">numbers")
    for name, count in summary.sources.items():
        add_row(table, name, count)
    results.print(table)


def _table(title: str, *headings: str) -> Table:
    return narrow_table(f"\n{title}", *headings)


def _short(value: float) -> str:
    """1e10 and 5e9 rather than 1e+10 and 5e+09."""
    return f"{value:.3g}".replace("e+0", "e").replace("e+", "e")


def _print_parts(structures: Sequence[Subsystem]) -> None:
    table = _table("shafts", "nodes", ">outer, m", ">inner, m", ">mass, kg", "source")
    for shaft in (shaft for part in structures for shaft in part.shafts):
        numbers = (f"{value:g}" for value in (shaft.outer_diameter, shaft.inner_diameter, shaft.mass))
        add_row(table, "–".join(map(str, shaft.nodes)), *numbers, shaft.source)
    results.print(table)
    table = _table("bodies", "node", ">mass, kg", ">about x, kg·m²", ">about y", ">about z", "source")
    for body in (body for part in structures for body in part.bodies):
        add_row(table, body.node, f"{body.mass:g}", *(f"{value:g}" for value in body.inertia), body.source)
    results.print(table)


def _print_connections(
    title: str, axes: Sequence[str], rows: Iterable[tuple[str, str, Connection | DriveConnection]]
) -> None:
    table = _table(title, "name", "between", "type", *axes, "source")
    for name, between, item in rows:
        add_row(table, name, between, item.type, *map(_short, item.stiffness), item.source)
    results.print(table)


def _print_drives(drive: DriveTemplate) -> None:
    at = drive.placement
    table = _table(f"drives: {drive.count} ({drive.source})", "drive", ">angle, °", *(f">{n}" for n in DRIVE_NODES))
    for i, angle in enumerate(np.degrees(drive_angles(drive))):
        add_row(table, i + 1, f"{angle:g}", *drive_nodes(drive, i))
    places = (at.front_seat, at.mesh, at.rear_seat, at.gearbox, at.rotor)
    add_row(table, "x, m", "", *(f"{place:g}" for place in places))
    results.print(table)
    print_sentence(
        f"{gear_pair(drive).centre_distance:.4g} m off the axis (places {at.source}), "
        f"mounted on node {drive.mount_node}, driving the ring gear at node {drive.ring_node}"
    )
    front, _, rear, output, rotor = drive_nodes(drive, 0)
    mount = drive.mount_node
    between = (f"{front}, {rear}–{mount}", f"{rear}–{output}", f"{output}, {rotor}–{mount}")
    rows = ((name, ends, getattr(drive, name)) for name, ends in zip(DRIVE_CONNECTIONS, between, strict=True))
    title = "connections of drive 1; N/m along and N·m/rad about x, radial r, tangential t"
    _print_connections(title, _DRIVE_AXES, rows)
    columns = (">outer, m", ">inner, m", ">mass, kg", ">about x, kg·m²", ">across", "source")
    table = _table("parts of a drive", "part", *columns)
    for name in DRIVE_PARTS:
        part = getattr(drive, name)
        values = (getattr(part, key, None) for key in ("outer_diameter", "inner_diameter", "mass"))
        cells = (*values, *getattr(part, "inertia", (None, None))[:2])
        add_row(table, name, *("" if value is None else f"{value:g}" for value in cells), part.source)
    results.print(table)


def _print_gears(summary: MachineSummary) -> None:
    drive = summary.machine.description.driveshaft
    headings = ("pair", "teeth", ">m, mm", ">α, °", ">b, mm", ">ε", ">mesh, Hz", "source")
    table = _table("gear pairs, from the ring to the motor", *headings)

    def add(pair: str, gears: Gear | PlanetaryStage, teeth: str, contact_ratio: float, mesh_hz: float) -> None:
        size = (1e3 * gears.module, gears.pressure_angle_deg, 1e3 * gears.face_width)
        rest = (f"{contact_ratio:.3f}", f"{mesh_hz:.2f}", gears.source)
        numbers = "/".join(str(getattr(gears, f"{name}_teeth")) for name in teeth.split("/"))
        add_row(table, pair, numbers, *(f"{value:g}" for value in size), *rest)

    pair = "ring/pinion"
    add(pair, drive.gear, pair, gear_pair(drive).contact_ratio, summary.machine.mesh_frequency)
    for number, (gears, stage) in enumerate(zip(drive.gearbox.stages, summary.stages, strict=True), start=1):
        for pair, ratio in (("ring/planet", stage.ring_contact_ratio), ("planet/sun", stage.sun_contact_ratio)):
            add(f"stage {number} {pair}", gears, pair, ratio, stage.mesh_frequency_hz)
    results.print(table)
    mesh = drive.mesh
    print_sentence(
        f"mesh of ring and pinion ({mesh.source}): {_short(mesh.mean_stiffness)} N/m, "
        f"backlash {mesh.backlash * 1e6:g} µm, damping ratio {mesh.damping_ratio:g}"
    )


def _print_gearbox(summary: MachineSummary) -> None:
    gearbox = summary.machine.description.driveshaft.gearbox
    headings = ("part", ">planets", ">ratio", ">N·m/rad at the pinion", "source")
    table = _table("gearbox, from the pinion to the motor", *headings)
    for number, (gears, stage) in enumerate(zip(gearbox.stages, summary.stages, strict=True), start=1):
        add_row(table, f"stage {number}", gears.planets, f"{stage.ratio:.4g}", _short(stage.stiffness), gears.source)
    add_row(table, "shafts", "", "", _short(gearbox.shaft_stiffness), gearbox.source)
    add_row(table, "together", "", f"{gearbox.ratio:.4g}", _short(summary.gearbox_stiffness), "")
    results.print(table)
    print_sentence(f"rotor {summary.rotor_speed_r_min:.0f} r/min")


def _print_cutters(cutters: CutterDescription, cutting: CuttingSummary) -> None:
    table = _table(f"cutters ({cutters.source})", "type", ">cutters", ">discs", ">radius, m")
    for name, kind in cutting.types.items():
        low, high = kind.radius
        add_row(table, name, kind.cutters, kind.discs, f"{low:.3f} to {high:.3f}")
    results.print(table)
    rock, disc = cutters.rock, cutters.disc
    print_sentence(
        f"discs {2e3 * disc.radius:g} mm across, tip {1e3 * disc.tip_width:g} mm ({disc.source}); "
        f"rock {rock.ucs_mpa:g} and {rock.bts_mpa:g} MPa ({rock.source})"
    )
    print_sentence(
        f"at the operating point {cutting.penetration_mm:.1f} mm a turn, a face disc "
        f"{cutting.normal_force_kn:.0f} and {cutting.rolling_force_kn:.1f} kN"
    )
    print_sentence(
        f"friction {cutters.friction_kn:g} kN, idle torque {cutters.idle_torque_kn_m:g} kN·m; "
        f"torque of the head {cutting.torque_kn_m:.0f} kN·m"
    )


def _print_modes(summary: MachineSummary) -> None:
    roles = {node.node: ", ".join(node.roles) for node in summary.nodes}
    table = _table("lowest natural frequencies", ">Hz", "motion", ">energy", "largest at node")
    for mode in summary.modes:
        share = f"{mode.shares[mode.motion]:.0%}"
        add_row(table, f"{mode.frequency_hz:.2f}", mode.motion, share, f"{mode.node} {roles[mode.node]}")
    results.print(table)


def print_loads(document: dict[str, Any]) -> None:
    """Print the document of `load_run` beside the paper's Table 1; forces in kN, moments in kN·m."""
    point = document["operating_point"]
    print_sentence(
        f"{document['machine']}: cutterhead loads, {document['loads']} model, {document['duration']:g} s, "
        f"seed {document['seed']}, at {point['speed'] * 30.0 / math.pi:.3g} r/min, {point['torque'] / 1e3:.5g} kN·m, "
        f"{point['thrust'] / 1e3:.5g} kN"
    )
    headings = (">paper", ">mean", ">RMS", ">in regions", "paper's lines", "found, Hz")
    title = "means (magnitudes), fluctuation, share of power in Table 1's regions; kN, kN·m"
    table = _table(title, "", *headings)
    for name, row in document["components"].items():
        numbers = (f"{abs(row[key]) / 1e3:.5g}" for key in ("paper_mean", "mean", "rms"))
        paper = ", ".join(f"{line['paper_hz']:g}" for line in row["lines"])
        found = ", ".join("–" if line["found_hz"] is None else f"{line['found_hz']:.2f}" for line in row["lines"])
        add_row(table, *(name, *numbers, f"{row['in_regions']:.0%}", paper, found))
    results.print(table)
