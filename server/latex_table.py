r"""The leaderboard as the paper lays its main table out (its `tab:main_results`), whole.

It wants `\usepackage{booktabs,graphicx}` and `\usepackage[table]{xcolor}`.
"""

from collections.abc import Iterable, Sequence

from server import latex
from server.schemas.leaderboard import Leaderboard, LeaderboardRow

HEADS = {
    "push_button_times": r"Push\\Button",
    "stack_blocks": r"Stack\\Blocks",
    "change_channel_times": r"Change\\Channel",
    "stack_cups_new": r"Stack\\Cups",
    "stack_blocks_new": r"Stack\\Blocks-N",
    "weighing_on_off": r"Weigh\\On/Off",
    "pour_put_back": r"Pour\\Back",
    "wipe_desk_rubbish": r"Wipe\\Desk",
    "light_bulb_in_out": r"Light\\Bulb",
    "reopen_drawer": r"Reopen\\Drawer",
    "search_drawer": r"Search\\Drawer",
    "search_boxes": r"Search\\Boxes",
    "search_cup_from_cabinet": r"Search\\Cabinet",
    "lift_and_check": r"Lift \&\\Check",
    "swap_square_pegs": r"Swap\\Pegs",
}
NAMES = {
    "RC": "Repetition Counting",
    "HSR": "Historical-State Recall",
    "EPT": "Execution-Progress Tracking",
}
COLOURS = {
    "HIDEOverall": "8C8278",
    "HIDEOrange": "D99A5E",
    "HIDEGreen": "588C78",
    "HIDEPurple": "8D75A5",
}
COLOUR_OF = {"RC": "HIDEOrange", "HSR": "HIDEGreen", "EPT": "HIDEPurple"}
FIRST = 3  # column of the tasks, behind the method and the average
WANTED = r"\usepackage{booktabs,graphicx} \usepackage[table]{xcolor}"


def whole(board: Leaderboard, remarks: Iterable[str], kinds: Sequence[str]) -> str:
    """A `table*` with head, categories, caption and all rows, references below a line."""
    ranked = [one for one in board.rows if not one.reference]
    references = [one for one in board.rows if one.reference]
    parts = [
        latex.comments([*remarks, f"wants {WANTED}"]),
        *(rf"\definecolor{{{name}}}{{HTML}}{{{code}}}" "\n" for name, code in COLOURS.items()),
        _opening(board, kinds),
        _head(kinds),
        *latex.marked(ranked, board.verdict, kinds),
        *_references(references, board, kinds, divided=bool(ranked)),
        _closing(kinds),
    ]
    return "".join(parts)


def _closing(kinds: Sequence[str]) -> str:
    fitted = "    }\n" if _fitted(kinds) else ""
    return f"        \\bottomrule\n    \\end{{tabular}}%\n{fitted}\\end{{table*}}\n"


def _fitted(kinds: Sequence[str]) -> bool:
    """One category is narrower than a page, and would be blown up."""
    return len(kinds) > 1


def _opening(board: Leaderboard, kinds: Sequence[str]) -> str:
    columns = "".join(rf"ccccc>{{\columncolor{{{COLOUR_OF[kind]}!12}}}}c" for kind in kinds)
    fitted = "    \\resizebox{\\textwidth}{!}{%\n" if _fitted(kinds) else ""
    return rf"""\begin{{table*}}[t]
    \centering
    \caption{{
        {_caption(board, kinds)}
    }}
    \label{{tab:hide_{board.split}}}
    \scriptsize
    \setlength{{\tabcolsep}}{{2.4pt}}
    \renewcommand{{\arraystretch}}{{1.10}}
{fitted}    \begin{{tabular}}{{@{{}}l>{{\columncolor{{HIDEOverall!10}}}}c{columns}@{{}}}}
"""


def _caption(board: Leaderboard, kinds: Sequence[str]) -> str:
    rates = {"success": "Success rates", "exact": "Rates of exact success"}[board.verdict]
    named = ", ".join(NAMES[kind].lower() for kind in kinds)
    return rf"""\textbf{{Performance on {latex.escaped(board.suite.upper())}, split {board.split}.}}
        {rates} (\%) on individual tasks and their category averages: {named}.
        The best and second-best results in each column are \textbf{{bold}} and
        \underline{{underlined}}, respectively, including ties; reference policies are not compared.
        Measured in PyBullet, and not comparable with figures of another simulator."""


def _head(kinds: Sequence[str]) -> str:
    groups = "".join(
        rf"        & \multicolumn{{6}}{{>{{\columncolor{{{COLOUR_OF[kind]}!28}}}}c}}"
        rf"{{\textbf{{{NAMES[kind]} ({kind})}}}}"
        "\n"
        for kind in kinds
    )
    rules = "".join(
        rf"        \cmidrule(lr){{{first}-{first + 5}}}" "\n"
        for first in range(FIRST, FIRST + 6 * len(kinds), 6)
    )
    tasks = "".join(
        "".join(rf"        & \shortstack{{{HEADS[name]}}}" "\n" for name in latex.COLUMNS[kind])
        + "        & \\textbf{Avg.}\n"
        for kind in kinds
    )
    return (
        "        \\toprule\n        &\n        \\cellcolor{white}\n"
        f"{groups}        \\\\\n{rules}"
        f"        \\textbf{{Method}}\n        & \\textbf{{Avg.}}\n{tasks}        \\\\\n"
        "        \\midrule\n"
    )


def _references(
    rows: Sequence[LeaderboardRow], board: Leaderboard, kinds: Sequence[str], *, divided: bool
) -> list[str]:
    if not rows:
        return []
    columns = FIRST - 1 + 6 * len(kinds)
    line = ["        \\midrule\n"] if divided else []
    title = rf"\multicolumn{{{columns}}}{{@{{}}l@{{}}}}{{\textit{{Reference policies}}}} \\" "\n"
    return [*line, f"        {title}", *latex.marked(rows, board.verdict, kinds)]
