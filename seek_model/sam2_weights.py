"""Meta's published weights of SAM 2.1, for the encoder of `sam2_trunk`."""

from pathlib import Path

from seek_model.sam2_encoder import Sam2Encoder
from seek_model.weight_files import fill, read_tensors

ENCODER = "image_encoder."
DECODER = "sam_mask_decoder."
SKIPS = ("conv_s0.", "conv_s1.")  # of the decoder, but part of what an image becomes


def load_encoder(encoder: Sam2Encoder, path: Path) -> None:
    """Fill an encoder that has no LoRA yet.

    Args:
        encoder: of the variant that the file is of.
        path: one of Meta's sam2.1_hiera_*.pt, or a .safetensors file of the same names.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is of another kind, or names the first tensor that is missing, unexpected or
            of the wrong shape.
    """
    tensors = {
        name.removeprefix(DECODER): value
        for name, value in read_tensors(path).items()
        if name.startswith(ENCODER) or name.removeprefix(DECODER).startswith(SKIPS)
    }
    fill(encoder, tensors, str(path))
