# SPDX-License-Identifier: GPL-3.0-or-later
"""A recipe's frames as tensors for training, each pair of a noisy and a clean image; all workers share the meshes.

python torch_dataset.py RECIPE NOISY_SETTING [CLEAN_FRAMES]
"""

import sys

import torch
from torch.utils.data import DataLoader, Dataset

import noisy_world


class NoisyAndClean(Dataset):
    """Pairs of a frame as a setting perturbs it and as it was, of all scenes of a recipe."""

    def __init__(self, recipe: str, setting: str, clean_frames: str | None = None) -> None:
        """Open the recipe, and load the meshes here, before workers are forked."""
        opened = noisy_world.open(recipe, clean_frames)
        self._noisy = opened.frames(setting, compressed=False).load()
        self._clean = {scene: opened[f"clean/{scene}"] for scene in opened.scenes}

    def __len__(self) -> int:
        return len(self._noisy)

    def __getitem__(self, place: int) -> dict[str, torch.Tensor]:
        """Return colour (3, H, W) uint8, noisy and clean, and noisy depth (H, W) in metres."""
        item = self._noisy[place]
        clean = self._clean[item["sequence"].split("/")[-1]][item["index"]].rgb_uncompressed
        return {
            "rgb": torch.from_numpy(item["rgb"]).permute(2, 0, 1),
            "clean_rgb": torch.from_numpy(clean).permute(2, 0, 1),
            "depth_m": torch.from_numpy(item["depth_m"]),
        }


if __name__ == "__main__":
    frames = NoisyAndClean(*sys.argv[1:])
    for batch in DataLoader(frames, batch_size=4, shuffle=True, num_workers=2, multiprocessing_context="fork"):
        print(tuple(batch["rgb"].shape), (batch["rgb"].float() - batch["clean_rgb"].float()).abs().mean())
