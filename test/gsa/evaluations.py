"""Cheap evaluations for campaigns; at module level, since worker processes import them."""

import os
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

OUTPUTS = ("force", "peak")
LONG_S = 300.0  # until which a busy computer does anything


def analytic(sample):
    """Two outputs of three inputs: one smooth, one that only x2 moves."""
    x2, x4, x16 = (sample[code] for code in ("x2", "x4", "x16"))
    return {"force": x2 / x16 + 1e4 * x4, "peak": (x2 / 1000.0) ** 2}


@dataclass(frozen=True)
class Traced:
    """`analytic` that leaves one file per call."""

    folder: str

    def __call__(self, sample):
        (Path(self.folder) / f"{sample['x2']!r}-{os.getpid()}").touch()
        return analytic(sample)


@dataclass(frozen=True)
class Held:
    """`Traced` whose calls after some do not end before there is a file `go`; whoever is held leaves a file, too."""

    folder: str
    free: int

    def __call__(self, sample):
        outputs = Traced(f"{self.folder}/calls")(sample)
        folder = Path(self.folder)
        if len(list((folder / "calls").iterdir())) > self.free:
            (folder / "held" / str(os.getpid())).touch()
            end = time.monotonic() + LONG_S
            while not (folder / "go").exists():
                if time.monotonic() > end:
                    raise TimeoutError("nobody says go")
                time.sleep(0.01)
        return outputs


def fails_above(sample):
    """Fails in three ways where x2 is large."""
    if sample["x2"] > 2300.0:
        raise RuntimeError("the run\ndiverged")
    if sample["x2"] > 2200.0:
        return {"force": 1.0}
    if sample["x2"] > 2100.0:
        return {"force": float("nan"), "peak": 1.0}
    return analytic(sample)


def doubtful(sample):
    """Fails in the highest seventh of x2; one output is noise to any surrogate, one is constant."""
    if sample["x2"] > 2285.0:
        raise RuntimeError(f"diverged at t = {sample['x4']} s")
    noise = float(np.random.default_rng(list(np.float64(tuple(sample.values())).view(np.uint32))).standard_normal())
    return {**analytic(sample), "noise": noise, "still": 3.0}


def kills_its_process(sample):
    if sample["x2"] > 2400.0:
        os._exit(3)
    return analytic(sample)


@dataclass(frozen=True)
class KillsItsProcessOnce:
    """Takes its process down at the first call in a folder; `analytic` from then on."""

    folder: str

    def __call__(self, sample):
        try:
            (Path(self.folder) / "killed").touch(exist_ok=False)
        except FileExistsError:
            return analytic(sample)
        os._exit(3)


def always_kills_its_process(sample):
    os._exit(3)


def threads(sample):
    """The number of threads a worker may use, as its environment and libraries say."""
    import numpy  # noqa: F401
    from threadpoolctl import threadpool_info

    most = max(info["num_threads"] for info in threadpool_info())
    return {"force": float(os.environ["OMP_NUM_THREADS"]), "peak": float(most) + 1e-9 * sample["x2"]}
