# SPDX-License-Identifier: GPL-3.0-or-later
"""README.md of a packed dataset: the dataset card that people and Hugging Face's hub read, made from its Croissant."""

import json
import re
from typing import Any

from .finished import Content
from .packed_names import TABLE

HUB_SIZES = ((10**3, "n<1K"), (10**4, "1K<n<10K"), (10**5, "10K<n<100K"), (10**6, "100K<n<1M"), (10**7, "1M<n<10M"))


def card(content: Content, described: dict[str, Any], tables_by: str) -> str:
    """Return the card. described: what croissant.json says. tables_by: the version of what wrote the table."""
    frames = sum(content.manifest["frames"].values())
    settings = sorted({name.split("/")[0] for name in content.sequences})
    scenes = sorted({name.split("/")[1] for name in content.sequences})
    tars = [item for item in described["distribution"] if item["encodingFormat"] == "application/x-tar"]
    size = sum(int(item["contentSize"].removesuffix(" B")) for item in tars)
    first, suffix = content.sequences[0], content.suffix("rgb")
    versions = ", ".join(f"{name} {version}" for name, version in sorted(content.identity["versions"].items()))
    conventions = "\n".join(f"- {name}: {text}" for name, text in sorted(content.manifest["conventions"].items()))
    return f"""\
{_front_matter(described, settings, frames)}
# {described["name"]}

{described["description"]}

**Licence**: {described["license"]}

| | |
|---|---|
| sequences | {len(tars)} |
| settings | {len(settings)} |
| scenes | {len(scenes)}: {", ".join(scenes)} |
| frames | {frames} |
| bytes in tars | {size} |

## Files

- `SETTING/SCENE.tar`: a sequence; `tar -xf` gives the folder that loaders of the {content.layout.label} layout read.
- `{TABLE}`: a row for every frame: pose, time stamps, what was done, hashes, and where its files lie in the tars.
- `manifest.json`: all that the dataset was made from, its conventions, and the hashes of its text files.
- `croissant.json`: this description for programs.

## Reading

As samples of WebDataset, without unpacking; `json` holds pose, intrinsics, depth scale, stamps and what was done:

```python
import io, numpy as np, webdataset as wds
from PIL import Image

steps = wds.handle_extension("depth.png", lambda data: np.array(Image.open(io.BytesIO(data))))
for frame in wds.WebDataset("{first}.tar", shardshuffle=False).decode(steps, "rgb8"):
    rgb, told = frame["rgb.{suffix}"], frame["json"]
    depth_m, c2w = frame["depth.png"] / told["depth_scale_per_m"], np.array(told["c2w"])
```

As a stream of Hugging Face's `datasets`: `load_dataset("webdataset", data_files="{first}.tar", streaming=True)`.

## Conventions

{conventions}

## Made with

{versions}; the table with {tables_by}.
"""


def _front_matter(described: dict[str, Any], settings: list[str], frames: int) -> str:
    """Return what the hub reads: the licence, and a configuration for each setting. JSON's texts are YAML's."""
    licence = described["license"]
    known = re.fullmatch(r"[a-z0-9]+([.-][a-z0-9]+)*", licence)
    size = next((name for limit, name in HUB_SIZES if frames < limit), "n>10M")
    rows = [f"license: {licence}"] if known else ["license: other", f"license_name: {json.dumps(licence)}"]
    rows += [f"pretty_name: {json.dumps(described['name'])}", f"size_categories: [{json.dumps(size)}]"]
    rows += [f"tags: {json.dumps(described['keywords'])}", "configs:"]
    for setting in settings:
        rows += [f"  - config_name: {json.dumps(setting)}", f"    data_files: {json.dumps(f'{setting}/*.tar')}"]
    return "\n".join(["---", *rows, "---"])
