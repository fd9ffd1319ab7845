"""Served policies as the command line names them, with files that declare their maps."""

import re
from pathlib import Path

import pytest

from workers.policies import BadPolicy, Remote, parse
from workers.remote.wires import Wire

GUIDE = Path(__file__).parents[3] / "docs" / "remote_policies.md"
EXAMPLES = re.findall(
    r"```toml\n# (\w+\.toml)(?:: hide eval (\S+)[^\n]*)?\n(.*?)```", GUIDE.read_text(), re.S
)
MINIMAL = 'observation = {prompt = {from = "instruction"}}\naction = {kind = "joint_position"}\n'


def test_the_guide_has_an_example_of_every_wire() -> None:
    assert [name for name, *_ in EXAMPLES] == [
        "pi0.toml",
        "openvla.toml",
        "libero.toml",
        "gr00t.toml",
    ]


@pytest.mark.parametrize(("name", "url", "content"), EXAMPLES)
def test_the_guides_examples_are_understood(
    name: str, url: str, content: str, tmp_path: Path
) -> None:
    (tmp_path / name).write_text(content)

    found = parse(url or "ws://gpu-box:8000", maps=tmp_path / name)

    assert isinstance(found, Remote)
    wires: dict[str, Wire] = {
        "pi0": "openpi",
        "openvla": "act",
        "libero": "vla_eval",
        "gr00t": "gr00t",
    }
    assert found.spec.wire == wires[name.removesuffix(".toml")]
    assert found.spec.observation and found.spec.action


@pytest.mark.parametrize(
    ("url", "wire"),
    [("ws://h:1", "openpi"), ("wss://h", "openpi"), ("https://h/act", "act"), ("tcp://h", "gr00t")],
)
def test_an_address_stands_for_a_wire(url: str, wire: str, tmp_path: Path) -> None:
    maps = tmp_path / "maps.toml"
    maps.write_text(MINIMAL)

    found = parse(url, maps=maps)

    assert isinstance(found, Remote)
    assert (found.spec.wire, found.text) == (wire, url)


@pytest.mark.parametrize(
    ("url", "more", "message"),
    [
        ("http://h/act", 'wire = "openpi"', "'http://h/act' is no URL such as ws://host:8000"),
        ("ws://h", 'wire = "act"', "'ws://h' is no URL such as http://host:8000"),
        ("ws://h", 'wire = "telnet"', "wire: Input should be 'openpi', 'vla_eval', 'act' or"),
        ("ws://h", "rate = 20", "rate: Extra inputs are not permitted"),
        ("tcp://h:99999", "", "is no URL"),
        ("ws://h", "wire = ", "is no TOML file that can be read"),
    ],
)
def test_what_does_not_fit_is_told(url: str, more: str, message: str, tmp_path: Path) -> None:
    maps = tmp_path / "maps.toml"
    maps.write_text(f"{more}\n{MINIMAL}")

    with pytest.raises(BadPolicy, match=re.escape(message)):
        parse(url, maps=maps)


@pytest.mark.parametrize("url", ["http://h/act", "tcp://h"])
def test_a_server_that_says_nothing_of_itself_needs_maps(url: str) -> None:
    with pytest.raises(BadPolicy, match="does not say what it wants to see"):
        parse(url)
