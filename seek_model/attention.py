"""Attention, the one way everywhere. b batch, g heads, n queries, m keys, d channels of a head."""

import torch
from jaxtyping import Float
from torch import Tensor, nn

FAR = -1e4  # stands for minus infinity; a query without any key gets a mean instead of NaN


def attend(
    q: Float[Tensor, "b g n d"],
    k: Float[Tensor, "b g m d"],
    v: Float[Tensor, "b g m c"],
    mask: Tensor | None = None,
    bias: Tensor | None = None,
    dropout: float = 0.0,
) -> Float[Tensor, "b g n c"]:
    """What the queries find.

    Args:
        q, k, v: queries, keys, values.
        mask: boolean, broadcast to (b g n m); True where a query may look.
        bias: added to the logits, broadcast to (b g n m).
        dropout: share of the weights that is dropped; 0 outside training.
    """
    if q.is_cuda:
        added = _additive(q, mask, bias)
        return nn.functional.scaled_dot_product_attention(
            q, k, v, attn_mask=added, dropout_p=dropout
        )
    # On a CPU torch's fused kernel is slow backwards: written out, training is 1.5 times faster.
    return nn.functional.dropout(weigh(q, k, mask, bias), dropout) @ v


def weigh(
    q: Float[Tensor, "b g n d"],
    k: Float[Tensor, "b g m d"],
    mask: Tensor | None = None,
    bias: Tensor | None = None,
) -> Float[Tensor, "b g n m"]:
    """The weights themselves; each query's sum to 1."""
    logits = (q * q.shape[-1] ** -0.5) @ k.transpose(-1, -2)
    if bias is not None:
        logits = logits + bias
    if mask is not None:
        logits = logits.masked_fill(~mask, FAR)
    return torch.softmax(logits, dim=-1)


def _additive(q: Tensor, mask: Tensor | None, bias: Tensor | None) -> Tensor | None:
    if mask is None:
        return None if bias is None else bias.to(q.dtype)
    hidden = torch.where(mask, 0.0, FAR)
    return (hidden if bias is None else hidden + bias).to(q.dtype)
