"""The same data step in fewer or better conditioned rows: weights taken apart, repeated shots merged, channels orthonormal."""

from dataclasses import replace
from typing import Any

import numpy as np

from recon.coded_aperture import CodedAperture
from recon.field_aperture import FieldAperture
from recon.operator import LinearOperator, RowWeighted

CUTOFF = 1e-6  # mixes of channels weaker than this part of the strongest are left out
EXACT = 1e-12  # below this part of the largest an eigenvalue is a zero with rounding


def unweighted(operator: LinearOperator, frames: np.ndarray) -> tuple[LinearOperator, np.ndarray, np.ndarray | None]:
    """Take ``diag(d) H`` apart: return H, g (0 where d = 0) and d of the frames' shape; None when there is no weighting."""
    if not isinstance(operator, RowWeighted):
        return operator, frames, None
    weights = operator.weights.astype(np.float64)
    inner, inside, more = unweighted(operator.operator, np.divide(frames, weights, out=np.zeros_like(frames), where=weights > 0))
    return inner, inside, weights if more is None else weights * more


def reduced(
    operator: CodedAperture | FieldAperture,
    frames: np.ndarray,
    weights: np.ndarray | None,
    notes: list[str],
    mixed: bool,
) -> tuple[CodedAperture | FieldAperture, np.ndarray, np.ndarray | None]:
    """Return an operator, frames and weights of the same data step with fewer rows and, when ``mixed``, with better conditioned ones.

    Shots that repeat a mask are merged. With ``mixed``, where rows may be scaled and mixed freely (rho = 0), the pixels' gains
    are divided out (pixels with gain 0 stay out) and the channels made orthonormal.
    """
    changes: dict[str, Any] = {"gray": True} if isinstance(operator, CodedAperture) else {}
    masks, merged, weights = merge_repeats(operator.masks, frames, weights)
    most = masks.max()
    response = operator.response * most
    free = mixed and alike(weights)
    if isinstance(operator, FieldAperture) and free:
        gain, plain = operator.readout.gain, not operator.readout.couples
        if gain is not None:
            merged = np.divide(merged, gain, out=np.zeros_like(merged), where=np.broadcast_to(gain > 0, merged.shape))
            left = (gain > 0).astype(np.float64)
            changes["readout"] = replace(operator.readout, gain=None if left.all() else left)
            free = bool(left.all()) or gain.ndim < 3 or gain.shape[0] == 1
        free = free and (plain or operator.readout.bins is None)
    if free:
        response, merged = whiten(response, operator.mosaic, merged, notes)
        weights = None if weights is None else np.broadcast_to(weights[:, :1], merged.shape)
    return operator.replace(masks=masks / most, response=response, **changes), merged, weights


def alike(weights: np.ndarray | None) -> bool:
    """Tell whether the channels of every pixel have one weight, so that they may be mixed."""
    return weights is None or bool((weights == weights[:, :1]).all())


def merge_repeats(
    masks: np.ndarray, frames: np.ndarray, weights: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Average the frames of shots that share a mask: the same normal equations in fewer rows.

    Without weights the mean is weighted by sqrt(count), masks and frames alike. With weights d (L, C, M, W) it is
    ``sum d^2 g / sum d^2`` with the weight ``sqrt(sum d^2)``.
    """
    groups: dict[bytes, list[int]] = {}
    for l, mask in enumerate(masks):
        groups.setdefault(mask.tobytes(), []).append(l)
    shots = list(groups.values())
    if weights is None:
        root = [np.sqrt(len(same)) for same in shots]
        kept = np.stack([w * masks[same[0]] for w, same in zip(root, shots)])
        return kept, np.stack([w * frames[same].mean(0) for w, same in zip(root, shots)]), None
    power = np.stack([(weights[same] ** 2).sum(0) for same in shots])
    total = np.stack([(weights[same] ** 2 * frames[same]).sum(0) for same in shots])
    mean = np.divide(total, power, out=np.zeros_like(total), where=power > 0)
    return np.stack([masks[same[0]] for same in shots]), mean, np.sqrt(power)


def whiten(response: np.ndarray, mosaic: np.ndarray | None, frames: np.ndarray, notes: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Make the channels orthonormal along wavelength (a mosaic's curves: of norm 1); mixes below the cutoff are left out."""
    if mosaic is not None:
        size = np.linalg.norm(response, axis=1)
        size[size == 0] = 1
        return response / size[:, None], frames / size[mosaic]
    u, s, vt = np.linalg.svd(response, full_matrices=False)
    rank = nearly_dependent(s, notes)
    mix = u[:, :rank].T / s[:rank, None]
    return np.ascontiguousarray(vt[:rank]), np.einsum("pc,lcmj->lpmj", mix, frames)


def nearly_dependent(s: np.ndarray, notes: list[str]) -> int:
    """Count the mixes of response curves that can be told apart, from the curves' singular values; note those that nearly can't."""
    rank = int((s > CUTOFF * s[0]).sum())
    if s[rank - 1] > 0 and rank < s.size and s[rank] > EXACT * s[0]:
        notes.append(
            f"the {s.size} response curves are nearly dependent (condition {s[0] / s[-1]:.1e}): only {rank} mixes of them were used"
        )
    return rank
