"""The sections of the results page about the trainings: curves, cost, where numbers come from."""

from docs.results_documents import Documents, record_of
from docs.results_words import NONE, duration, markdown
from seek_model.study import Study


def curves(documents: Documents, study: Study, beside: str) -> str:
    there = [run.name for run in study.runs if run.name in documents.curves]
    lacking = [run.name for run in study.runs if run.name not in documents.curves]
    said = f"![Loss and validation of every training]({beside}curves.svg)"
    if lacking:
        said += f"\n\nNo curves of {', '.join(lacking)}."
    said += "\n\nThe loss is that of the place, coarse and fine, which all models have in common."
    return said if there else f"No curves yet.\n\n{said}"


def cost(documents: Documents, study: Study) -> str:
    rows, trained, played = [], 0.0, 0.0
    for run in study.runs:
        record = record_of(documents, run)
        if not record:
            rows.append([run.name, run.preset, *[NONE] * 5])
            continue
        origin = record["provenance"]
        trained += origin["seconds"]
        played += record.get("episode_seconds", 0.0)
        pace, spent = record.get("samples_per_second"), record.get("policy_seconds")
        each = f"{spent / record['decisions']:.2f}" if spent and record["decisions"] else NONE
        size = f"{record['parameters'] / 1e6:.2f}"
        rows.append([run.name, run.preset, size, origin["step"], duration(origin["seconds"]),
                     NONE if pace is None else f"{pace:.1f}", each])  # fmt: skip
    head = ["run", "preset", "parameters, M", "steps", "training", "samples/s", "s a decision"]
    played += sum(one["episode_seconds"] for one in documents.results["references"].values())
    return (
        f"{markdown(head, rows)}\nAll of it: {duration(trained)} of training, and "
        f"{duration(played)} of episodes, which as many workers as there are processors play side "
        "by side. A decision's time is one worker's, with the way to the policy's process and back."
        f"{_expected(documents, study)}"
    )


def _expected(documents: Documents, study: Study) -> str:
    known = documents.times.get(study.name)
    if not known or not known["seconds"]:
        return ""
    said = ", ".join(f"{kind} {duration(seconds)}" for kind, seconds in known["seconds"].items())
    return f"\n\nA step of `make reproduce`, on {known['processors']} processors: {said}."


def provenance(documents: Documents, study: Study, beside: str) -> str:
    rows = []
    for run in study.runs:
        record = record_of(documents, run)
        if record:
            origin = record["provenance"]
            rows.append([run.name, f"`{record['sha256'][:16]}`", f"`{origin['data'][:16]}`",
                         origin["seed"], origin["torch"], record.get("ended", NONE)])  # fmt: skip
    head = ["run", "checkpoint, SHA-256", "demonstrations", "seed", "torch", "evaluated"]
    methods = documents.results["statistics"]
    return (
        f"{markdown(head, rows or [[NONE] * 6])}\nMethods: `{methods}`. "
        f"[results.json]({beside}results.json) has whole hashes and the verdict of every episode."
    )
