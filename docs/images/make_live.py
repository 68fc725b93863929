"""The picture of the live view: what `tbm-monitor run` puts on its topics, recorded by `bag record`, then drawn.

python docs/images/make_live.py
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import scipy.signal
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image
from rosbags.typesys import Stores, get_typestore

from tbm_dynamics import load_machine
from tbm_gsa.app.report.picture import write_picture
from tbm_msgs_py import Bag, read_acceleration
from tbm_msgs_py.blocks import from_cloud
from tbm_msgs_py.topics import TEST_POINTS

G = 9.80665
SHOWN_S = 2.0
BEGIN_NS = 2_000_000_000  # of the recording left out
HIGHEST_HZ = 160.0
MESH_FORCES = "/tbm/model/mesh_forces"
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9")
COMMAND = (sys.executable, "-m", "tbm_gsa.app.cli.main")


def record(folder: Path) -> Path:
    """Run the nodes for some seconds and record them."""
    out = folder / "live"
    names = [*(f"model/{point}/block" for point in TEST_POINTS), "model/mesh_forces"]
    with subprocess.Popen([*COMMAND, "run", "--duration", "30", "--out", str(folder / "run")]) as running:
        subprocess.run(
            [*COMMAND, "bag", "record", "--out", str(out), "--duration", "20", "--topics", ",".join(names)], check=True
        )
        running.wait()
    return out


def mesh_forces(bag: Path, start_ns: int) -> tuple[np.ndarray, np.ndarray]:
    """Read times (n,), s from a start on, and forces (n, 10), kN."""
    types = get_typestore(Stores.ROS2_JAZZY)
    clouds = [
        from_cloud(types.deserialize_cdr(message.data, "sensor_msgs/msg/PointCloud2"))
        for message in Bag(bag).messages([MESH_FORCES])
    ]
    times = (np.concatenate([cloud.times_ns() for cloud in clouds]) - start_ns) / 1e9
    return times[times >= 0.0], np.concatenate([cloud.values for cloud in clouds])[times >= 0.0] / 1e3


def draw(bag: Path) -> Figure:
    """Two seconds of five test points, half a second of ten meshes and the spectrum of one."""
    figure = Figure(figsize=(13.0, 6.5), layout="constrained")
    figure.suptitle("tbm-monitor run: what the topics carried", x=0.01, ha="left", fontsize=13)
    left, right = figure.subfigures(1, 2, width_ratios=(1.4, 1.0))
    panels = left.subplots(len(TEST_POINTS), 1, sharex=True)
    names = [f"/tbm/model/{point}/block" for point in TEST_POINTS]
    signals = [read_acceleration(bag, name) for name in names]
    start_ns = max(signal.start_ns for signal in signals) + BEGIN_NS
    for panel, topic, signal, colour in zip(panels, names, signals, COLOURS, strict=True):
        time = signal.time - (start_ns - signal.start_ns) / 1e9
        shown = (time >= 0.0) & (time < SHOWN_S)
        panel.plot(time[shown], signal.values[shown, 0] / G, colour, linewidth=0.7)
        dress(panel, f"{topic}, axial, g", SHOWN_S)
    panels[-1].set_xlabel("s")

    time, forces = mesh_forces(bag, start_ns)
    above, below = right.subplots(2, 1)
    shown = time < SHOWN_S / 4.0
    above.plot(time[shown], forces[shown], linewidth=0.7)
    dress(above, f"{MESH_FORCES}, ten pinions, kN", SHOWN_S / 4.0)
    above.set_xlabel("s")

    rate = 1.0 / np.median(np.diff(time))
    frequency, density = scipy.signal.welch(forces[:, 0], rate, nperseg=round(4.0 * rate))
    below.semilogy(frequency, density, COLOURS[0], linewidth=0.8)
    mesh = load_machine("dz101").mesh_frequency
    for name, line in ((f"mesh, {mesh:.1f} Hz", mesh), ("load, 130.3 Hz", 130.3)):
        below.axvline(line, color="#888", linestyle=":", linewidth=1.0)
        below.text(line + 1.5, density.max(), name, fontsize=9, va="top")
    dress(below, "first pinion: density, kN²/Hz", HIGHEST_HZ)
    below.set_ylim(density.max() / 1e7, density.max() * 2.0)
    below.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    below.set_xlabel("Hz")
    return figure


def dress(panel: Axes, title: str, end: float) -> None:
    """Title, width and no frame."""
    panel.set_title(title, loc="left", fontsize=9, family="monospace")
    panel.set_xlim(0.0, end)
    panel.spines[["top", "right"]].set_visible(False)


def main() -> None:
    """Make docs/images/live.png."""
    with tempfile.TemporaryDirectory() as name:
        bag = record(Path(name))
        file = Path(__file__).with_name("live.png")
        write_picture(lambda: draw(bag), file)
    Image.open(file).convert("RGB").quantize(128).save(file, optimize=True)  # a third of the size


if __name__ == "__main__":
    main()
