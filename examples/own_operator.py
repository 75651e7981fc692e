"""Reconstruct with a camera that optsim does not know: a dual-disperser CASSI, by forward and adjoint alone, then with its H H^T."""

import numpy as np

from recon import GramBlocks, reconstruct
from recon.metrics import psnr


class DualDisperser:
    """``g[m, n] = sum_k mask[m, n + k] f[m, n, k]``: the code is sheared, the picture is not."""

    def __init__(self, mask, bands):
        rows, columns = mask.shape[0], mask.shape[1] - bands + 1
        self.in_shape, self.out_shape = (rows, columns, bands), (rows, columns)
        self.code = np.stack([mask[:, k : k + columns] for k in range(bands)], axis=2)

    def forward(self, x):
        return (self.code * x).sum(2)

    def adjoint(self, y):
        return self.code * y[:, :, None]


class Knowing(DualDisperser):
    """The same camera, which also tells that no two of its pixels share a voxel: H H^T is diagonal."""

    def gram_blocks(self):
        power = (self.code**2).sum(2)
        return GramBlocks(np.arange(power.size)[:, None], power.reshape(-1, 1, 1))


y, x, k = np.ogrid[:48, :48, :12]
truth = (1.2 + np.sin(y / 9 + k / 4) * np.cos(x / 7)) * np.exp(-(((k - 4 - 4 * (x > 24)) / 5) ** 2))
mask = np.random.default_rng(1).integers(0, 2, (48, 48 + 11)).astype(float)
for camera in (DualDisperser(mask, 12), Knowing(mask, 12)):
    solution = reconstruct(camera, camera.forward(truth))
    print(f"{type(camera).__name__:14s} {psnr(solution.cube, truth):.2f} dB in {solution.iterations} iterations: {solution.stop}")
