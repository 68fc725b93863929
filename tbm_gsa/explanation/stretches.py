"""A recording explained stretch by stretch: cut where the vibration changes while the machine is driven alike."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Final

from tbm_dynamics import Machine
from tbm_gsa.comparison.results import ComparisonResult
from tbm_gsa.comparison.workflow import compare_recording
from tbm_gsa.explanation.result import Explanation, StretchFinding
from tbm_gsa.explanation.workflow import ExplainOptions, explain
from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_gsa.signals.settings import Settings
from tbm_msgs_py.base.errors import RecordingError

MODEL_S: Final = 4.0
"""Length of the model's run of a comparison, of which an explanation takes nothing but the names of the bands."""

WINDOW_S: Final = 0.5
"""Of the windows that tell when the recording changes: many, for it may be short."""


@dataclass(frozen=True, eq=False)
class ExplainedStretch:
    """A finding, and the explanation behind it where there is a verdict."""

    finding: StretchFinding
    explanation: Explanation | None


def explain_stretches(
    bag: Path, machine: Machine, folder: Path, options: ExplainOptions | None = None
) -> list[ExplainedStretch]:
    """Explain each stretch of a recording by itself.

    The window about a change belongs to neither of its neighbours.

    Parameters
    ----------
    bag : Path
    machine : Machine
    folder : Path
        Gets a folder for each stretch, ``stretch_1`` …
    options : ExplainOptions, optional

    Raises
    ------
    RecordingError
        A recording that cannot be compared.
    """
    fine = Settings(window_s=WINDOW_S)
    whole = compare_recording(bag, machine, model_duration=MODEL_S, settings=fine).result
    ends = (0.0, *whole.changes, whole.recording.duration)
    found = []
    for number, (begin, end) in enumerate(pairwise(ends), start=1):
        inner = (
            begin + (whole.window_s if number > 1 else 0.0),
            end - (whole.window_s if number < len(ends) - 1 else 0.0),
        )
        found.append(_explained(bag, machine, whole, inner, folder / f"stretch_{number}", options))
    return found


def _explained(
    bag: Path,
    machine: Machine,
    whole: ComparisonResult,
    span: tuple[float, float],
    folder: Path,
    options: ExplainOptions | None,
) -> ExplainedStretch:
    begin, end = span
    try:
        part = compare_recording(bag, machine, model_duration=MODEL_S, span=span).result if whole.changes else whole
        folder.mkdir(parents=True, exist_ok=True)
        found = explain(part, folder, options)
    except (StudyError, RecordingError) as error:
        return ExplainedStretch(
            StretchFinding(begin=begin, end=end, verdict=None, sentence=str(error), folder=None), None
        )
    finding = StretchFinding(begin=begin, end=end, verdict=found.verdict, sentence=found.sentence(), folder=str(folder))
    return ExplainedStretch(finding, found)
