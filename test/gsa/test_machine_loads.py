"""`machine loads`: the loads of both models against the paper's Table 1; what finds lines and shares of power.

Sources: Table 1 of the paper as the issue's bounds have it (means within 1 %, 80 % of the power in the regions, lines
within 0.5 Hz, the discs' thrust and torque within 5 %); Shock and Vibration 2018, 8798232 (cutter forces mainly below
10 Hz); sines and white noise, whose spectra are known; Parseval.
"""

import json
import signal
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tbm_gsa.app.cli.main import main
from tbm_gsa.paper.load_summary import RATE_HZ, ComponentSummary, found_line, load_run
from tbm_gsa.paper.published import TABLE_1


@pytest.fixture
def command(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(signal, "signal", lambda *_: None)  # handlers stay those of the test process

    def run(line):
        monkeypatch.setattr(sys, "argv", ["tbm-monitor", *line.split()])
        with pytest.raises(SystemExit) as end:
            main()
        return end.value.code, *capsys.readouterr()

    return run


@pytest.mark.parametrize("seed", [0, 7])
def test_the_spectral_level_is_table_1(machine, seed):
    found = load_run(machine, "spectral", 600.0, seed).summary.components
    for name, row in found.items():
        assert abs(row.mean) == pytest.approx(TABLE_1[name].mean, rel=0.01)
        assert row.in_regions > 0.8
        for line in row.lines:
            assert line.found_hz == pytest.approx(line.paper_hz, abs=0.5)


@pytest.mark.parametrize("seed", range(4))
def test_cutter_loads_have_their_thrust_and_torque(machine, seed):
    run = load_run(machine, "cutter", 120.0, seed)
    found = run.summary.components
    assert abs(found["fx"].mean) == pytest.approx(TABLE_1["fx"].mean, rel=0.05)
    assert abs(found["mx"].mean) == pytest.approx(TABLE_1["mx"].mean, rel=0.05)
    fluctuation = run.values - run.values.mean(axis=0)
    power = np.abs(np.fft.rfft(fluctuation, axis=0)) ** 2
    below = power[np.fft.rfftfreq(len(fluctuation), 1.0 / RATE_HZ) < 10.0].sum(axis=0) / power.sum(axis=0)
    assert np.all(below > 0.6)


@settings(max_examples=20)
@given(
    frequency=st.floats(0.6, 220.0),
    share=st.floats(0.0, 1.0),
    seed=st.integers(0, 2**32 - 1),
    mean=st.floats(-1e7, 1e7),
)
def test_a_line_is_found_where_it_is_and_noise_is_none(frequency, share, seed, mean):
    time = np.arange(60_000) / RATE_HZ
    noise = np.random.default_rng(seed).standard_normal(len(time))
    # 60 s of white noise of unit variance: a sine of 0.2 is 0.02 x 60 s x 1000 Hz / 1.5 / 2 = 400 times a bin of it.
    sine = np.sin(2 * np.pi * frequency * time)
    quiet, loud = (ComponentSummary.of(mean + noise + a * sine, TABLE_1["fx"]) for a in (0, 0.2))
    assert all(line.found_hz is None or abs(line.paper_hz - frequency) < 0.6 for line in loud.lines)
    assert all(line.found_hz is None for line in quiet.lines)
    spectrum = np.abs(np.fft.rfft((noise + 0.2 * sine) * np.hanning(len(time)))) ** 2
    wanted = frequency + 0.4 * share
    assert found_line(np.fft.rfftfreq(len(time), 1 / RATE_HZ), spectrum, wanted) == pytest.approx(frequency, abs=0.05)
    # White noise fills the regions of F_x, 20 of 500 Hz.
    assert quiet.in_regions == pytest.approx(20.0 / 500.0, rel=0.15)
    assert quiet.rms == pytest.approx(1.0, rel=0.03)


def test_a_load_that_does_not_move():
    still = ComponentSummary.of(np.full(20_000, 3.0), TABLE_1["mx"])
    assert (still.mean, still.rms, still.in_regions) == (3.0, 0.0, 0.0)
    assert [line.found_hz for line in still.lines] == [None, None]


def test_the_command_prints_and_draws_the_loads(command):
    code, out, err = command("machine loads --duration 20 --loads cutter --json --out loads.png")
    assert (code, err) == (0, "drawing: loads.png\n")
    assert json.loads(out)["components"]["fx"]["paper_mean"] == 1.2e7
    assert Path("loads.png").read_bytes().startswith(b"\x89PNG")
    code, out, err = command("machine loads --duration 20")
    assert (code, err) == (0, "")
    assert "106.2, 204.5" in out
    assert max(map(len, out.splitlines())) <= 80


def test_loads_of_another_machine_are_held_against_its_file(command):
    code, out, _ = command("machine loads --machine open380 --duration 20 --json")
    rows = json.loads(out)["components"]
    assert (code, rows["fx"]["paper_mean"], rows["fx"]["stated_mean"]) == (0, None, 5.0e6)
    assert [(line["stated_hz"], line["paper_hz"]) for line in rows["fx"]["lines"]] == [(1.5, None), (67.0, None)]
    assert all(row["in_regions"] > 0.7 for row in rows.values())
    assert "Table 1" not in command("machine loads --machine open380 --duration 20")[1]


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("machine loads --duration 5", "duration 5 s, allowed: 20 s or more"),
        ("machine loads --machine open380 --loads cutter", "open380: cutters: missing"),
        ("machine loads --loads rock", "Invalid value for '--loads'"),
        ("machine loads --out loads.pdf", "loads.pdf: unknown kind of picture"),
        ("simulate --schedule nowhere.csv", "nowhere.csv: No such file or directory, allowed: a CSV file"),
        ("simulate --schedule-where cycle=7", "--schedule-column and --schedule-where: allowed only with --schedule"),
        ("simulate --schedule fast.csv", "fast.csv: line 2: operating point: speed 9 r/min, allowed are up to 7.6"),
        ("run --schedule fast.csv", "fast.csv: line 2: operating point: speed 9 r/min, allowed are up to 7.6"),
    ],
)
def test_bad_input_is_one_line(command, line, message):
    Path("fast.csv").write_text("time_s,speed_r_min,torque_kn_m,thrust_kn\n0,9,2000,9000\n", "utf-8")
    code, out, err = command(line)
    assert (code, out, len(err.splitlines())) == (2, "", 1), err
    assert err.startswith(f"tbm-monitor: {message}")


def test_a_run_on_the_recorded_start(command, startup_cycles):
    columns = "time=t_s speed=rpm torque=torque_kNm thrust=thrust_kN"
    options = " ".join(f"--schedule-column {column}" for column in columns.split())
    where = "--schedule-where cycle=181011_15"
    code, out, _ = command(f"simulate --duration 1 --schedule {startup_cycles} {options} {where} --json")
    document = json.loads(out)
    assert (code, document["schedule"]) == (0, str(startup_cycles))
    # 1402 kN·m at the start, ten drives, base radius 1.5153 m: 92.5 kN each, 0.9 Hz and the meshes around it.
    assert document["mesh_force"]["mean"] == pytest.approx(1402e3 / 10 / 1.5153, rel=0.25)
