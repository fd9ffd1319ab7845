"""Evaluations and the leaderboard as files, read back with what their readers would use."""

import csv
import io
import json
import re
import zipfile
from collections.abc import Iterator
from itertools import accumulate

import pytest

from hide_tasks import SUITES, load
from hide_tasks.contract import Category, EpisodeSpec, Failure
from server import board_exports, latex, leaderboard
from server.exports import TableFormat, line_of
from server.models import now
from server.schemas.common import RatePublic, Verdicts
from server.schemas.leaderboard import Leaderboard, LeaderboardRow
from server.standings import BoardQuery, shown
from tests.server import ledgers
from tests.server.clients import API, TestClient, client, hub_of, problem_of

TASKS = ["push_button_times", "search_drawer"]
EPISODES = 6  # of each


def outcome(spec: EpisodeSpec) -> Failure | None:
    """Exact, successful, or neither, by turns."""
    return (None, Failure.OVERCOUNT, Failure.UNDERCOUNT)[spec.index % 3]


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    with client(tmp_path_factory.mktemp("exports")) as found:
        yield found


@pytest.fixture(scope="module")
def evaluation(here: TestClient) -> str:
    hub = hub_of(here)
    wanted = {"tasks": TASKS, "episodes": EPISODES}
    return ledgers.evaluated(hub.database, hub.blobs, "noop", outcome, **wanted)


@pytest.fixture(scope="module")
def hard(here: TestClient) -> str:
    """A whole evaluation of another suite."""
    hub = hub_of(here)
    return ledgers.evaluated(hub.database, hub.blobs, "random", outcome, suite="hide-hard")


def exported(here: TestClient, path: str, **query: str) -> bytes:
    answer = here.get(f"{API}{path}/export", params=query)
    assert answer.status_code == 200, answer.text
    kind, name = answer.headers["content-type"], answer.headers["content-disposition"]
    assert kind and name.startswith("attachment; filename=")
    return answer.content


def test_json_holds_the_evaluation_its_rates_and_its_episodes(
    here: TestClient, evaluation: str
) -> None:
    found = json.loads(exported(here, f"/evaluations/{evaluation}"))

    assert found["evaluation"] == here.get(f"{API}/evaluations/{evaluation}").json()
    rates = {name: one["success"]["successes"] for name, one in found["tasks"].items()}
    assert rates == dict.fromkeys(TASKS, 4)
    listed = here.get(f"{API}/evaluations/{evaluation}/episodes").json()["items"]
    assert found["episodes"] == listed and len(listed) == 12


def test_csv_holds_a_line_per_episode(here: TestClient, evaluation: str) -> None:
    text = exported(here, f"/evaluations/{evaluation}", format="csv").decode()

    rows = list(csv.DictReader(io.StringIO(text)))
    assert len(rows) == 12
    assert [row["success"] for row in rows[:3]] == ["true", "true", "false"]
    assert [row["exact"] for row in rows[:3]] == ["true", "false", "false"]
    assert [row["failure"] for row in rows[:3]] == ["", "overcount", "undercount"]
    assert json.loads(rows[0]["variation"]) and rows[0]["decisions"] == "3"


def test_json_lines_hold_every_decision(here: TestClient, evaluation: str) -> None:
    lines = exported(here, f"/evaluations/{evaluation}", format="jsonl").decode().splitlines()

    found = [json.loads(line) for line in lines]
    assert len(found) == 12
    assert [len(one["decisions"]) for one in found] == [3] * 12
    path = f"{API}/episodes/{found[0]['id']}/decisions"
    assert found[0]["decisions"] == here.get(path).json()
    assert found[0]["start"]["hidden"]["presses_done"] == 0


def test_a_zip_holds_all_of_them(here: TestClient, evaluation: str) -> None:
    content = exported(here, f"/evaluations/{evaluation}", format="zip")

    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        assert archive.testzip() is None
        found = {name.removeprefix(f"{evaluation}/"): archive.read(name)
                 for name in archive.namelist()}  # fmt: skip
    assert set(found) == {"evaluation.json", "episodes.csv", "episodes.jsonl", "row.tex"}
    assert found["episodes.csv"] == exported(here, f"/evaluations/{evaluation}", format="csv")
    assert len(found["episodes.jsonl"].splitlines()) == 12


def cells_of(text: str) -> list[list[str]]:
    rows = [line for line in text.splitlines() if not line.startswith("%")]
    assert all(line.endswith(r" \\") for line in rows)
    return [[cell.strip() for cell in line.removesuffix(r"\\").split("&")] for line in rows]


def test_the_latex_row_has_the_papers_columns(here: TestClient, evaluation: str) -> None:
    text = exported(here, f"/evaluations/{evaluation}", format="latex").decode()
    exact = exported(here, f"/evaluations/{evaluation}", format="latex", verdict="exact").decode()

    [row], [strict] = cells_of(text), cells_of(exact)
    assert len(row) == 1 + 1 + 3 * 6
    assert row[0] == "noop@1" and (row[2], strict[2]) == ("67", "33")  # push_button_times
    assert row[14] == "67"  # search_drawer
    assert row.count("--") == 17  # tasks that were not played, and every average
    assert evaluation in text and "not comparable with the paper" in text


def test_the_papers_columns_are_the_suites_tasks() -> None:
    named = [task for tasks in latex.COLUMNS.values() for task in tasks]

    assert sorted(named) == sorted(SUITES["hide"])
    for category, tasks in latex.COLUMNS.items():
        assert {str(load(task).category) for task in tasks} == {category}


@pytest.mark.usefixtures("evaluation")  # which wants that nothing else waits
def test_an_evaluation_that_has_not_begun_has_no_numbers(here: TestClient) -> None:
    asked = {"policy": "noop", "tasks": TASKS, "episodes": 1}
    waiting = here.post(f"{API}/evaluations", json=asked).json()["id"]

    [row] = cells_of(exported(here, f"/evaluations/{waiting}", format="latex").decode())
    lines = exported(here, f"/evaluations/{waiting}", format="csv").decode().splitlines()

    assert set(row[1:]) == {"--"} and len(lines) == 3
    assert exported(here, f"/evaluations/{waiting}", format="jsonl") == b""
    here.post(f"{API}/evaluations/{waiting}/cancellation")


def row_of(name: str, rank: int | None, successes: int) -> LeaderboardRow:
    """A policy that has so many successes in the 25 episodes of every task."""
    rate, whole = RatePublic.of(successes, 25), RatePublic.of(15 * successes, 375)
    return LeaderboardRow(
        rank=rank,
        rank_best=rank,
        rank_worst=rank,
        evaluation=f"ev_{name}",
        policy=name,
        version=1,
        reference=rank is None,
        ended=now(),
        tasks={task: Verdicts(success=rate, exact=rate) for task in SUITES["hide"]},
        categories={},
        overall=Verdicts(success=whole, exact=whole),
    )


@pytest.fixture(scope="module")
def board() -> Leaderboard:
    rows = [row_of("better", 1, 24), row_of("good_one", 2, 20), row_of("bad", 3, 0)]
    return Leaderboard(
        suite="hide 1",
        split="test",
        verdict="success",
        columns=leaderboard.columns(),
        ceilings={},
        rows=[*rows, row_of("expert", None, 25)],
        unlisted=0,
    )


def whole(board: Leaderboard, format: TableFormat) -> str:
    return b"".join(board_exports.of_leaderboard(board, format)).decode()


def test_latex_marks_the_best_of_the_leaderboard(board: Leaderboard) -> None:
    rows = {row[0]: row[1:] for row in cells_of(whole(board, TableFormat.LATEX))}

    assert list(rows) == ["better@1", r"good\_one@1", "bad@1", "expert@1"]
    assert rows["better@1"][:2] == [r"\textbf{96.0}", r"\textbf{96}"]
    assert rows[r"good\_one@1"][:2] == [r"\underline{80.0}", r"\underline{80}"]
    assert rows["bad@1"][:2] == ["0.0", "0"]
    assert rows["expert@1"][:2] == ["100.0", "100"]  # it knows the hidden state
    assert {len(row) for row in rows.values()} == {19}


def test_the_whole_table_is_laid_out_as_in_the_paper(board: Leaderboard) -> None:
    [text] = board_exports.of_leaderboard(board, TableFormat.LATEX, table=True)
    table = text.decode()

    balance(table)
    assert table.count(r"\columncolor") == 4 + 3 and table.count(r"\shortstack") == 15
    assert [line.strip() for line in table.splitlines() if "cmidrule" in line] == [
        r"\cmidrule(lr){3-8}",
        r"\cmidrule(lr){9-14}",
        r"\cmidrule(lr){15-20}",
    ]
    rows = [line for line in table.splitlines() if "@1 &" in line]
    assert rows == whole(board, TableFormat.LATEX).splitlines()[1:]
    assert all(line.count(" & ") == 19 for line in rows)
    assert "not comparable with figures of another simulator" in table


def test_a_category_alone_has_its_columns_and_the_average_of_all(board: Leaderboard) -> None:
    only = shown(board, BoardQuery(category=Category.HISTORICAL_STATE_RECALL))
    [text] = board_exports.of_leaderboard(only, TableFormat.LATEX, table=True)
    table = text.decode()

    balance(table)
    assert "Historical-State Recall (HSR)" in table and "Repetition Counting" not in table
    assert "better@1 & " + r"\textbf{96.0}" in table
    assert all(line.count(" & ") == 7 for line in table.splitlines() if "@1 &" in line)


def balance(table: str) -> None:
    """Environments, braces and cells of a table are whole; comments aside."""
    code = re.sub(r"(?<!\\)%.*", "", table)
    plain = code.replace(r"\&", "").replace(r"\{", "").replace(r"\}", "").replace(r"\%", "")
    depths = list(accumulate({"{": 1, "}": -1}.get(char, 0) for char in plain))
    assert min(depths) == 0 and depths[-1] == 0
    open_ones: list[str] = []
    for verb, name in re.findall(r"\\(begin|end)\{([^}]+)\}", plain):
        if verb == "begin":
            open_ones.append(name)
        else:
            assert open_ones.pop() == name
    assert open_ones == []
    [columns] = re.findall(r"\\begin\{tabular\}\{(.+)\}", code)
    count = len(re.sub(r">\{[^}]*\}\}|@\{\}", "", columns))
    body = plain.partition(r"\toprule")[2].partition(r"\bottomrule")[0]
    stacked = re.sub(r"\\shortstack\{[^}]*\}", "", body)
    for line in stacked.split("\\\\")[:-1]:
        spans = [int(one) for one in re.findall(r"\\multicolumn\{(\d+)\}", line)]
        assert line.count("&") + 1 + sum(spans) - len(spans) == count, line


def test_files_have_the_rows_and_the_order_that_are_asked_for(board: Leaderboard) -> None:
    only = shown(board, BoardQuery(search="o", sort="policy", order="desc"))
    found = list(csv.DictReader(io.StringIO(whole(only, TableFormat.CSV))))
    latex_rows = [row[0] for row in cells_of(whole(only, TableFormat.LATEX))]

    assert [(row["rank"], row["policy"]) for row in found] == [("2", "good_one")]
    assert latex_rows == [r"good\_one@1"]


def test_csv_holds_a_line_per_policy(board: Leaderboard) -> None:
    found = list(csv.DictReader(io.StringIO(whole(board, TableFormat.CSV))))

    assert [(row["rank"], row["policy"], row["success"]) for row in found] == [
        ("1", "better", "0.96"),
        ("2", "good_one", "0.8"),
        ("3", "bad", "0.0"),
        ("", "expert", "1.0"),
    ]
    assert found[0]["success_search_drawer"] == "0.96" and found[0]["exact_episodes"] == "375"


@pytest.mark.parametrize("format", list(TableFormat))
def test_the_leaderboard_is_given_out(here: TestClient, format: TableFormat) -> None:
    text = exported(here, "/leaderboard", format=format.value).decode()

    if format is TableFormat.JSON:
        assert json.loads(text) == here.get(f"{API}/leaderboard").json()
    else:
        assert len(text.splitlines()) == 1  # nobody is on it


@pytest.mark.parametrize("text", ["=1+1", "+1", "-1", "@sum", "\t=1", "\r=1"])
def test_a_cell_is_no_formula(text: str) -> None:
    [[cell, number]] = csv.reader(io.StringIO(line_of([text, -1]).decode(), newline=""))

    assert cell == f"'{text}" and number == "-1"


def test_what_latex_would_read_is_escaped() -> None:
    assert latex.escaped("50 %_{a}&\\input\nx") == r"50 \%\_\{a\}\&\textbackslash{}input x"


# --- other suites ---


def test_a_leaderboard_of_another_suite_has_its_columns_and_says_so_in_its_name(
    here: TestClient, hard: str
) -> None:
    of = {"suite": "hide-hard"}
    answer = here.get(f"{API}/leaderboard/export", params=of | {"verdict": "exact"})
    told = answer.headers["content-disposition"]
    [row] = csv.DictReader(io.StringIO(answer.text))

    assert 'filename="leaderboard-hide-hard-test-exact.csv"' in told
    assert (row["evaluation"], row["exact_episodes"]) == (hard, str(25 * len(SUITES["hide-hard"])))
    tasks = {name.removeprefix("exact_") for name in row} & {*SUITES["hide"], *SUITES["hide-hard"]}
    assert tasks == set(SUITES["hide-hard"])
    found = json.loads(exported(here, "/leaderboard", format="json", **of))
    assert found == here.get(f"{API}/leaderboard", params=of).json()
    usual = here.get(f"{API}/leaderboard/export").headers["content-disposition"]
    assert 'filename="leaderboard-test-success.csv"' in usual


def test_the_papers_table_is_of_its_suite_alone(here: TestClient, hard: str) -> None:
    of_board = {"suite": "hide-hard", "table": "true"}
    for path, query, instead in (
        ("/leaderboard/export", of_board, "json, csv"),
        (f"/evaluations/{hard}/export", {}, "json, csv, jsonl, zip"),
    ):
        answer = here.get(API + path, params=query | {"format": "latex"})

        assert answer.status_code == 422
        [error] = problem_of(answer)["errors"]
        assert error["field"] == "format" and "of suite 'hide' alone" in error["message"]
        assert error["message"].endswith(f"of 'hide-hard' there are {instead}")


def test_a_zip_of_another_suite_lacks_the_papers_row(here: TestClient, hard: str) -> None:
    content = exported(here, f"/evaluations/{hard}", format="zip")

    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        names = {name.removeprefix(f"{hard}/") for name in archive.namelist()}
    assert names == {"evaluation.json", "episodes.csv", "episodes.jsonl"}
