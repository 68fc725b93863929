"""The JSON document of a reproduction; its keys are a contract, docs/reproduction.md lists them."""

from collections.abc import Mapping, Sequence
from typing import Any

from tbm_dynamics import Machine
from tbm_gsa.paper.reproduction.readings import Reading
from tbm_gsa.paper.reproduction.response import ResponseEvidence
from tbm_gsa.paper.reproduction.row import Row, count_verdicts
from tbm_gsa.provenance import machine_sha256, package_versions


def reproduction_document(
    rows: Sequence[Row],
    machine: Machine,
    both: Sequence[Reading],
    responses: Sequence[ResponseEvidence],
    seed: int,
    sizes: Mapping[str, Any],
    seconds: Mapping[str, float],
) -> dict[str, Any]:
    """Gather a reproduction: equal inputs and seed give equal documents but for ``seconds``.

    Returns
    -------
    dict
        ``rows[{id, source, what, paper, ours, difference, unit, verdict, note, reading}]``, ``verdicts{agrees …}`` of
        the machine's own reading of the dampings, ``other_reading{…}`` of the other one, ``readings``, ``machine``,
        ``machine_file``, ``recording``, ``seed``, ``sizes``, ``versions``, ``seconds``.
    """
    own = [row for row in rows if row.reading in (None, both[0].name)]
    compared = responses[0].comparison.result
    return {
        "rows": [row.to_dict() for row in rows],
        "verdicts": count_verdicts(own),
        "other_reading": count_verdicts([row for row in rows if row.reading == both[1].name]),
        "readings": [{"name": one.name, "title": one.title, "own": one.own, "fitted": one.fitted} for one in both],
        "machine": machine.name,
        "machine_file": {"origin": machine.origin, "sha256": machine_sha256(machine)},
        "recording": {
            "path": compared.recording.path,
            "sha256": compared.recording.sha256,
            "synthetic": compared.synthetic,
        },
        "seed": seed,
        "sizes": dict(sizes),
        "versions": package_versions(),
        "seconds": {**seconds, "total": sum(seconds.values())},
    }
