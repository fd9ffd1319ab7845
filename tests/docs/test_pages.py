"""The pages of the tasks are generated, and are those of the present tasks."""

import re
from pathlib import Path

import pytest

from docs import make_pages

FOUND = make_pages.pages()


def test_there_is_a_page_for_every_task_and_no_other():
    assert {path.name for path in make_pages.FOLDER.glob("*.md")} == set(FOUND)


@pytest.mark.parametrize("name", FOUND)
def test_a_page_is_what_its_task_says(name):
    path = make_pages.FOLDER / name

    assert path.read_text() == FOUND[name], "run .venv/bin/python docs/make_pages.py"
    for target in re.findall(r"\]\(([^)]+)\)", FOUND[name]):
        assert Path(path.parent, target).exists(), target
