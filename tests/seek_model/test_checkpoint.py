"""A checkpoint comes back as it was, and a file that is none is told by its first mismatch."""

import json
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors.torch import save
from torch import Tensor, nn

from seek_model import checkpoint
from seek_model.checkpoint import load, weights
from seek_model.checkpoint_header import BadCheckpoint, Provenance, read_header
from seek_model.config import Config, ConvFilm
from seek_model.network import Network
from tests.seek_model.trainings import tiny

ROOT = Path(__file__).parents[2]
PROVENANCE = Provenance(
    project="0.1.0",
    torch="2.13.0",
    suite="hide",
    version=1,
    data="abc",
    tasks=("search_drawer",),
    phase="second",
    step=5,
    seed=0,
    seconds=1.5,
)


@pytest.fixture(scope="module")
def config() -> Config:
    return tiny()


@pytest.fixture(scope="module")
def network(config: Config) -> Network:
    torch.manual_seed(0)
    return Network(config.model)


@pytest.fixture
def file(tmp_path: Path, config: Config, network: Network) -> Path:
    path = tmp_path / "checkpoint.safetensors"
    checkpoint.save(path, weights(network), config, PROVENANCE)
    return path


def changed(file: Path, change: Callable[[dict[str, Any]], object]) -> Path:
    """The same file with another header; its tensors' bytes stay."""
    content = file.read_bytes()
    length = struct.unpack("<Q", content[:8])[0]
    header = json.loads(content[8 : 8 + length])
    change(header)
    text = json.dumps(header).encode()
    file.write_bytes(struct.pack("<Q", len(text)) + text + content[8 + length :])
    return file


def saved(path: Path, config: Config, tensors: dict[str, Tensor]) -> Path:
    checkpoint.save(path, tensors, config, PROVENANCE)
    return path


def test_a_checkpoint_comes_back_as_it_was(file: Path, config: Config, network: Network) -> None:
    loaded, its_config, header = load(file)

    assert its_config == config
    assert header.provenance == PROVENANCE
    assert header.parameters == sum(one.numel() for one in weights(network).values())
    assert not loaded.training
    own = weights(network)
    assert {name: one.tolist() for name, one in weights(loaded).items()} == {
        name: one.tolist() for name, one in own.items()
    }


def test_nothing_else_is_left_beside_it(file: Path) -> None:
    assert list(file.parent.iterdir()) == [file]


def test_the_header_is_read_without_torch_or_numpy(file: Path) -> None:
    program = (
        "import sys; from pathlib import Path\n"
        "from seek_model.checkpoint_header import read_header\n"
        f"assert read_header(Path({str(file)!r})).config.name == 'tiny'\n"
        "assert not {'torch', 'numpy', 'safetensors'} & set(sys.modules)\n"
    )

    subprocess.run([sys.executable, "-c", program], check=True, cwd=ROOT)


def test_the_header_of_bytes_is_that_of_the_file(file: Path) -> None:
    assert read_header(file.read_bytes()) == read_header(file)


def test_a_tensor_of_two_names_is_kept_once_and_shared_again() -> None:
    class Shared(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.one = nn.Linear(2, 2)
            self.two = self.one

    module = Shared()

    own = weights(module)
    checkpoint.fill(module, {name: torch.ones_like(one) for name, one in own.items()})

    assert set(own) == {"one.weight", "one.bias"}
    assert torch.equal(module.two.weight, torch.ones(2, 2))


def at(*path: str | int, to: Any) -> Callable[[dict[str, Any]], object]:
    def change(header: dict[str, Any]) -> None:
        place: Any = header
        for key in path[:-1]:
            place = place[key]
        place[path[-1]] = to

    return change


def of_metadata(key: str, *path: str | int, to: Any) -> Callable[[dict[str, Any]], object]:
    def change(header: dict[str, Any]) -> None:
        document = json.loads(header["__metadata__"][key])
        at(*path, to=to)(document)
        header["__metadata__"][key] = json.dumps(document)

    return change


ONE = "language.table.weight"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda header: header.pop("__metadata__"), "format is None"),
        (at("__metadata__", "format", to="other 2"), "format is 'other 2'"),
        (lambda header: header["__metadata__"].pop("config"), "config is missing"),
        (at("__metadata__", "config", to="{"), "config is no JSON"),
        (at("__metadata__", "config", to="[]"), "config is list"),
        (at("__metadata__", "config", to='{"a": 1, "a": 2}'), "'a' comes twice"),
        (at("__metadata__", "config", to='{"a": NaN}'), "NaN is not JSON"),
        (of_metadata("config", "model", "memory", "windw", to=3), "config.model.memory.windw"),
        (of_metadata("config", "model", "views", "size", to=-1), "config.model.views.size"),
        (of_metadata("provenance", "step", to=-1), "provenance.step"),
        (at(ONE, "dtype", to="F7"), f"tensor '{ONE}': unknown dtype 'F7'"),
        (at(ONE, "shape", to=[2, 2]), f"tensor '{ONE}': F32 of shape [2, 2] takes 16 bytes"),
        (at(ONE, "shape", to=[-1]), f"tensor '{ONE}': expected as shape"),
        (at(ONE, "shape", to=[1] * 9), f"tensor '{ONE}': expected as shape"),
        (at(ONE, "data_offsets", to=[0]), f"tensor '{ONE}': expected as shape"),
        (at(ONE, to=3), f"tensor '{ONE}': expected dtype, shape and data_offsets"),
        (lambda header: header.pop(min(set(header) - {"__metadata__"})), "starts at byte"),
    ],
)
def test_a_header_that_is_wrong_is_told(
    file: Path, change: Callable[[dict[str, Any]], object], message: str
) -> None:
    changed(file, change)

    with pytest.raises(BadCheckpoint) as error:
        read_header(file)

    assert message in str(error.value)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "a file of 0 bytes"),
        (b"PK\x03\x04 a zip of torch", "its first 8 bytes give a header of"),
        (struct.pack("<Q", 50) + b"{}", "ends within its header: 58 bytes of 10"),
        (struct.pack("<Q", 2**60), "its first 8 bytes give a header of"),
        (struct.pack("<Q", 3) + b"[1]", "the header is list"),
        (struct.pack("<Q", 3) + b"\xff{}", "the header is no JSON"),
        (struct.pack("<Q", 99_999) + b"[" * 99_999, "the header is no JSON"),
        (save({"x": torch.zeros(3)}), "format is None"),
    ],
)
def test_a_file_that_is_no_checkpoint_is_told(content: bytes, message: str) -> None:
    with pytest.raises(BadCheckpoint) as error:
        read_header(content)

    assert message in str(error.value)


def test_a_file_that_was_cut_or_grew_is_told(file: Path) -> None:
    content = file.read_bytes()

    for other in (content[:-1], content + b"x"):
        with pytest.raises(BadCheckpoint, match="the tensors take"):
            read_header(other)


def without(tensors: dict[str, Tensor]) -> None:
    del tensors["coarse.stop.net.3.bias"]


def with_another(tensors: dict[str, Tensor]) -> None:
    tensors["stranger"] = torch.zeros(1)


def of_other_shape(tensors: dict[str, Tensor]) -> None:
    tensors["coarse.stop.net.3.bias"] = torch.zeros(2)


def of_other_kind(tensors: dict[str, Tensor]) -> None:
    tensors["coarse.stop.net.3.bias"] = torch.zeros(1, dtype=torch.float64)


def of_brain_floats(tensors: dict[str, Tensor]) -> None:
    tensors["coarse.stop.net.3.bias"] = torch.zeros(1, dtype=torch.bfloat16)


def infinite_half(tensors: dict[str, Tensor]) -> None:
    tensors["coarse.stop.net.3.bias"] = torch.tensor([float("inf")]).half()


def not_a_number(tensors: dict[str, Tensor]) -> None:
    tensors["coarse.stop.net.3.bias"] = torch.tensor([float("nan")])


def infinite(tensors: dict[str, Tensor]) -> None:
    tensors["coarse.stop.net.3.bias"] = torch.tensor([float("inf")])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (without, "'coarse.stop.net.3.bias' is missing: float32 of shape [1]"),
        (with_another, "'stranger' is unexpected"),
        (of_other_shape, "is of shape [2]; expected float32 of shape [1]"),
        (of_other_kind, "is float64 of shape [1]; expected float32 of shape [1]"),
        (of_brain_floats, "is bfloat16 of shape [1]; expected float32 of shape [1]"),
        (infinite_half, "1 of 1 values are NaN or infinite"),
        (not_a_number, "1 of 1 values are NaN or infinite"),
        (infinite, "1 of 1 values are NaN or infinite"),
    ],
)
def test_weights_that_do_not_fit_are_told(
    tmp_path: Path,
    config: Config,
    network: Network,
    change: Callable[[dict[str, Tensor]], None],
    message: str,
) -> None:
    tensors = dict(weights(network))
    change(tensors)
    path = saved(tmp_path / "odd.safetensors", config, tensors)

    with pytest.raises(BadCheckpoint) as error:
        load(path)

    assert message in str(error.value)


def test_weights_of_half_precision_are_widened(
    tmp_path: Path, config: Config, network: Network
) -> None:
    halved = checkpoint.halved(weights(network))

    loaded, _, header = load(saved(tmp_path / "half.safetensors", config, halved))

    assert {one.dtype for one in header.tensors.values()} == {"F16"}
    for name, one in weights(loaded).items():
        assert one.dtype == torch.float32
        assert torch.equal(one, halved[name].float())


def test_only_numbers_of_single_precision_are_halved() -> None:
    tensors = {
        "single": torch.ones(1),
        "double": torch.ones(1, dtype=torch.float64),
        "bytes": torch.ones(1, dtype=torch.uint8),
        "empty": torch.ones(0),
    }

    kinds = [one.dtype for one in checkpoint.halved(tensors).values()]

    assert kinds == [torch.float16, torch.float64, torch.uint8, torch.float16]


def test_what_half_precision_does_not_have_is_told() -> None:
    with pytest.raises(ValueError, match="tensor 'large' holds 70000; float16 ends at 65504"):
        checkpoint.halved({"fine": torch.ones(1), "large": torch.tensor([-70_000.0])})


def test_half_precision_is_not_taken_for_whole_numbers() -> None:
    module = nn.BatchNorm1d(2)  # counts its batches

    with pytest.raises(BadCheckpoint, match=r"is float16 of shape \[\]; expected int64"):
        checkpoint.fill(module, {**weights(module), "num_batches_tracked": torch.ones(()).half()})


def test_a_misfit_changes_no_weight(network: Network) -> None:
    tensors = {name: torch.zeros_like(one) for name, one in weights(network).items()}
    not_a_number(tensors)
    before = weights(network)[ONE].clone()

    with pytest.raises(BadCheckpoint):
        checkpoint.fill(network, tensors)

    assert torch.equal(weights(network)[ONE], before)


def test_a_failed_write_keeps_the_file_that_was_there(file: Path) -> None:
    before = file.read_bytes()

    with pytest.raises(RuntimeError, match="disk full"), checkpoint.written(file) as part:
        part.write_bytes(b"half of it")
        raise RuntimeError("disk full")

    assert file.read_bytes() == before
    assert list(file.parent.iterdir()) == [file]


def test_files_that_pretrained_parts_came_from_are_not_needed() -> None:
    from seek_model.presets import preset

    model = preset("seek-paper").model
    named = model.model_copy(
        update={
            "language": model.language.model_copy(update={"weights": "/a", "vocabulary": "/b"}),
            "backbone": model.backbone.model_copy(update={"weights": "/c"}),
        }
    )

    assert checkpoint.self_contained(named) == model


def test_a_short_file_that_asks_for_a_huge_network_is_refused_before_it_is_built(
    tmp_path: Path, config: Config
) -> None:
    wide = ConvFilm(widths=(8, 16), channels=2**20, depth=2, heads=4)  # some 100 TB
    huge = config.model_copy(
        update={"model": config.model.model_copy(update={"backbone": wide, "memory": None})}
    )
    path = tmp_path / "huge.safetensors"
    checkpoint.save(path, {"coarse.some": torch.zeros(1)}, huge, PROVENANCE)

    with pytest.raises(BadCheckpoint, match="is missing"):
        checkpoint.load(path)


def test_a_header_with_many_names_is_read_in_no_time(file: Path) -> None:
    content = file.read_bytes()
    names = ",".join(f'"t{i}":1' for i in range(200_000)) + ',"t199999":1'
    text = f"{{{names}}}".encode()

    with pytest.raises(BadCheckpoint, match="'t199999' comes twice"):
        read_header(struct.pack("<Q", len(text)) + text + content[-100:])


def test_a_network_whose_tables_would_fill_the_memory_is_not_built(
    tmp_path: Path, config: Config
) -> None:
    views = config.model.views.model_copy(update={"size": 512})
    backbone = ConvFilm(widths=(8,), channels=16, depth=1, heads=2)
    memory = config.model.memory
    assert memory
    memory = memory.model_copy(update={"colocation": True})
    parts = {"views": views, "backbone": backbone, "memory": memory}
    large = config.model_copy(update={"model": config.model.model_copy(update=parts)})
    with torch.device("meta"):
        shapes = Network(large.model).state_dict()
    tensors = {name: torch.zeros(one.shape) for name, one in shapes.items()}

    with pytest.raises(BadCheckpoint, match="tables would take"):
        load(saved(tmp_path / "large.safetensors", large, tensors))


def test_a_name_that_fills_a_page_is_refused(file: Path) -> None:
    with pytest.raises(BadCheckpoint, match=r"config.name: .*at most 100"):
        read_header(changed(file, of_metadata("config", "name", to="x" * 101)))
