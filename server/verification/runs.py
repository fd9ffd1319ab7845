"""The folder of a run of `hide eval`: what a ledger is asked, as far as a folder has it."""

import json
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from hide_tasks import UnknownTask, suite
from hide_tasks.contract import EpisodeResult, InvalidAction, parse_action
from hide_tasks.machine import fingerprint
from server.evaluations import Counts, current_sources
from server.verification import simulation
from server.verification.files import check_recording
from server.verification.findings import Findings
from server.verification.simulation import Replay
from server.verification.verdicts import judged, policy_failure
from workers import run_folder
from workers.policies import hash_of_file
from workers.resimulation import Recorded
from workers.results import Results

Key = tuple[str, int]
Document = dict[str, Any]


def verify_run(
    path: Path,
    *,
    sample: int | None = 2,
    workers: int = 1,
    say: Callable[[str], None] = lambda _: None,
) -> Findings:
    """Everything that the folder holds.

    Raises:
        FolderError: it is no run's.
    """
    results = run_folder.read(path)
    findings = Findings(evaluations=1)
    decisions = _decisions(path, findings)
    chosen: list[Replay] = []
    for task in results.tasks:
        episodes = [one for one in results.episodes if one.task == task]
        _check_numbers(results, task, episodes, findings)
        suspicious = [
            one for one in episodes if not _check(path, results, one, decisions, findings)
        ]
        picked = {one.index: one for one in simulation.sampled(episodes, sample)}
        if sample != 0:
            picked |= {one.index: one for one in suspicious}
        chosen += _replays(results, list(picked.values()), decisions, findings)
    say(f"{path}: {len(chosen)} of {len(results.episodes)} episodes are played again")
    played = simulation.play_again(chosen, findings, workers=workers)
    verdicts = [
        played[name].result if (name := run_folder.name_of(one)) in played else one
        for one in results.episodes
    ]
    findings.scores[str(path)] = _counts(verdicts)
    findings.expect(
        str(path), "score", _counts(results.episodes)._asdict(), _counts(verdicts)._asdict()
    )
    return findings


def _counts(episodes: list[EpisodeResult]) -> Counts:
    number = len(episodes)
    success, exact = sum(one.success for one in episodes), sum(one.exact for one in episodes)
    return Counts(expected=number, final=number, success=success, exact=exact)


def _decisions(path: Path, findings: Findings) -> dict[Key, list[Document]]:
    found: dict[Key, list[Document]] = defaultdict(list)
    for number, line in enumerate(run_folder.decision_lines(path), start=1):
        try:
            document = json.loads(line)
            found[document.pop("task"), document.pop("index")].append(document)
        except (ValueError, KeyError, TypeError, AttributeError):
            where = f"{run_folder.DECISIONS}, line {number}"
            findings.note(str(path), where, "a decision", "JSON", line.strip())
    return found


def _check_numbers(
    results: Results, task: str, episodes: list[EpisodeResult], findings: Findings
) -> None:
    """None twice, and none that was not asked for."""
    there = [one.index for one in episodes]
    wanted = sorted({index for index in there if index < results.planned.get(task, 0)})
    findings.expect(task, results.split, {"episodes": there}, {"episodes": wanted})


def _check(
    path: Path,
    results: Results,
    one: EpisodeResult,
    decisions: dict[Key, list[Document]],
    findings: Findings,
) -> bool:
    """Notes what of an episode does not agree; true if everything does."""
    findings.episodes += 1
    known = len(findings.mismatches)
    name, found = run_folder.name_of(one), decisions[one.task, one.index]
    stored = one.model_dump(mode="json")
    try:
        expected: Document = {"decisions": len(found), **judged(one.failure, {}, found)}
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        findings.note(name, "", "decisions", "a list of decisions", repr(error))
        expected = {}
    if digest := results.digests.get(name):
        expected["digest"] = run_folder.run_digest(one, found)
        stored["digest"] = digest
    if results.sources.get(one.task) == current_sources().get(one.task):
        expected |= _expected_of_suite(one)
        stored["scene_hash"] = one.scene_hash[: len(expected.get("scene_hash", ""))]
    findings.expect(name, "", stored, expected)
    _check_file(path, results, one, findings)
    return len(findings.mismatches) == known


def _expected_of_suite(one: EpisodeResult) -> Document:
    try:
        spec = suite.episode(one.task, one.split, one.index)
    except (ValueError, UnknownTask):
        return {"index": None}
    hashes = suite.committed(one.task).get("splits", {}).get(one.split, {})
    scenes = hashes.get("scene_hashes", [])[one.index : one.index + 1]
    return {"variation": spec.variation, **({"scene_hash": scenes[0]} if scenes else {})}


def _check_file(path: Path, results: Results, one: EpisodeResult, findings: Findings) -> None:
    if one.recording is None:
        return
    name, file = run_folder.name_of(one), path / one.recording
    findings.files += 1
    if not file.resolve().is_relative_to(path.resolve()) or not file.is_file():
        findings.note(name, "", "recording", one.recording, None)
        return
    wanted = results.recording_hashes.get(one.recording)
    found = hash_of_file(file)
    if wanted in (None, found):
        said = one.model_dump(mode="json")
        if results.checkpoint is None:  # a checkpoint may have moved while the run broke off
            said["policy"] = results.policy
        check_recording(file, name, said, findings)
    else:
        findings.note(name, one.recording, "sha256", wanted, found)


def _replays(
    results: Results,
    episodes: list[EpisodeResult],
    decisions: dict[Key, list[Document]],
    findings: Findings,
) -> Iterator[Replay]:
    for one in episodes:
        name, found = run_folder.name_of(one), decisions[one.task, one.index]
        if results.sources.get(one.task) != current_sources().get(one.task):
            findings.leave_out("the task's sources have changed since it was played")
            continue
        try:
            recorded = Recorded(
                key=name,
                spec=suite.episode(one.task, one.split, one.index),
                rules=results.rules,
                actions=tuple(parse_action(document["action"]) for document in found),
                fault=policy_failure(one.failure),
            )
        except (InvalidAction, ValidationError, KeyError, ValueError, UnknownTask) as error:
            findings.note(name, "", "action log", "actions", " ".join(str(error).split()))
            continue
        same_machine = results.machine == fingerprint()
        stored = one.model_dump(mode="json")
        yield Replay(recorded, name, stored, found, None, same_machine)
