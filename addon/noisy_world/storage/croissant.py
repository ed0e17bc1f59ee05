# SPDX-License-Identifier: GPL-3.0-or-later
"""croissant.json: a packed dataset in the words of MLCommons' Croissant 1.0, for catalogues and loaders."""

from typing import Any

from ..core.channels import CHANNELS
from ..core.datasets.layouts import Modality
from .finished import Content
from .frame_table import table_columns
from .packed_names import FRAMES_FOLDER, TABLE, PackedFile

MEDIA_TYPES = {"jpg": "image/jpeg", "png": "image/png", "exr": "image/x-exr", "npy": "application/x-npy"}
CONFORMS_TO = "http://mlcommons.org/croissant/1.0"
# As the specification gives it: https://docs.mlcommons.org/croissant/docs/croissant-spec.html
CONTEXT: dict[str, Any] = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "citeAs": "cr:citeAs",
    "column": "cr:column",
    "conformsTo": "dct:conformsTo",
    "cr": "http://mlcommons.org/croissant/",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataBiases": "cr:dataBiases",
    "dataCollection": "cr:dataCollection",
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/",
    "equivalentProperty": "cr:equivalentProperty",
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "extract": "cr:extract",
    "field": "cr:field",
    "fileObject": "cr:fileObject",
    "fileProperty": "cr:fileProperty",
    "fileSet": "cr:fileSet",
    "format": "cr:format",
    "includes": "cr:includes",
    "isLiveDataset": "cr:isLiveDataset",
    "jsonPath": "cr:jsonPath",
    "key": "cr:key",
    "md5": "cr:md5",
    "parentField": "cr:parentField",
    "path": "cr:path",
    "personalSensitiveInformation": "cr:personalSensitiveInformation",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "recordSet": "cr:recordSet",
    "references": "cr:references",
    "regex": "cr:regex",
    "repeated": "cr:repeated",
    "replace": "cr:replace",
    "samplingRate": "cr:samplingRate",
    "sc": "https://schema.org/",
    "separator": "cr:separator",
    "source": "cr:source",
    "subField": "cr:subField",
    "transform": "cr:transform",
}
NO_LICENCE = "The licences of the scenes apply; the dataset states none of its own."
TYPES = {"string": "sc:Text", "int32": "sc:Integer", "int64": "sc:Integer", "float64": "sc:Float", "pose": "sc:Float"}


def croissant(content: Content, name: str, tars: list[PackedFile], table: PackedFile) -> dict[str, Any]:
    """Return the content of croissant.json. name: the dataset's. tars: of the sequences. table: manifest.parquet."""
    frames = [
        {
            "@type": "cr:Field",
            "@id": f"frames/{column}",
            "name": column,
            "description": meaning,
            "dataType": TYPES[kind],
            **({"repeated": True} if kind == "pose" else {}),
            "source": {"fileObject": {"@id": TABLE}, "extract": {"column": column}},
        }
        for column, (kind, meaning) in table_columns(content.modalities).items()
    ]
    return {
        "@context": CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": CONFORMS_TO,
        "name": name,
        "description": _description(content),
        "license": content.identity["preset"].get("output", {}).get("licence") or NO_LICENCE,
        "version": "1.0.0",
        "keywords": ["RGB-D", "SLAM", "robustness", "synthetic data"],
        "isLiveDataset": False,
        "distribution": [
            _file(
                table,
                "application/x-parquet",
                "a row for every frame: pose, time stamps, what was done, hashes, places",
            ),
            *(_file(tar, "application/x-tar", f"the sequence {tar.name.removesuffix('.tar')}") for tar in tars),
            *(_images(content, modality, tars) for modality in content.modalities),
        ],
        "recordSet": [
            {
                "@type": "cr:RecordSet",
                "@id": "frames",
                "name": "frames",
                "description": "every frame of every sequence",
                "key": [{"@id": f"frames/{column}"} for column in ("setting", "scene", "frame")],
                "field": frames,
            }
        ],
    }


def _file(file: PackedFile, encoding: str, description: str) -> dict[str, Any]:
    return {
        "@type": "cr:FileObject",
        "@id": file.name,
        "name": file.name,
        "description": description,
        "contentUrl": file.name,
        "contentSize": f"{file.size} B",
        "encodingFormat": encoding,
        "sha256": file.sha256,
    }


def _images(content: Content, modality: Modality, tars: list[PackedFile]) -> dict[str, Any]:
    suffix = content.suffix(modality)
    ending = f"{modality}.{suffix}"
    what = CHANNELS[modality].describe_files(content.depth_scale_per_m, suffix)
    return {
        "@type": "cr:FileSet",
        "@id": f"{modality}-images",
        "name": f"{modality}-images",
        "description": f"{what} images, named SETTING/SCENE/{FRAMES_FOLDER}/NUMBER.{ending}",
        "containedIn": [{"@id": tar.name} for tar in tars],
        "encodingFormat": MEDIA_TYPES[suffix],
        "includes": f"*/*/{FRAMES_FOLDER}/*.{ending}",
    }


def _description(content: Content) -> str:
    settings, scenes = ({name.split("/")[place] for name in content.sequences} for place in (0, 1))
    several = "s" if len(settings) > 1 else ""
    return (
        f"RGB-D sequences with exact poses: {len(scenes)} scene{'s' if len(scenes) > 1 else ''} under {len(settings)} "
        f"setting{several}, {sum(content.manifest['frames'].values())} frames; made by Noisy World "
        f"{content.identity['versions']['noisy_world']}, seed {content.identity['seed']}."
    )
