"""A Croissant description of records in Parquet: JSON-LD by which data sets are found and read."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from integ_gym.support.files.writing import file_hash

from ...schema.arrow import described
from ...store.parquet_file import check_schema
from ...store.store import EvidenceStore
from ..selection import Selection

CROISSANT_FILE = "croissant.json"

CONFORMS_TO = "http://mlcommons.org/croissant/1.0"

_CONTEXT: dict[str, Any] = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "citeAs": "cr:citeAs",
    "column": "cr:column",
    "conformsTo": "dct:conformsTo",
    "cr": "http://mlcommons.org/croissant/",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/",
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "extract": "cr:extract",
    "field": "cr:field",
    "fileProperty": "cr:fileProperty",
    "fileObject": "cr:fileObject",
    "fileSet": "cr:fileSet",
    "format": "cr:format",
    "includes": "cr:includes",
    "isLiveDataset": "cr:isLiveDataset",
    "jsonPath": "cr:jsonPath",
    "key": "cr:key",
    "md5": "cr:md5",
    "parentField": "cr:parentField",
    "path": "cr:path",
    "recordSet": "cr:recordSet",
    "references": "cr:references",
    "regex": "cr:regex",
    "repeated": "cr:repeated",
    "replace": "cr:replace",
    "sc": "https://schema.org/",
    "separator": "cr:separator",
    "source": "cr:source",
    "subField": "cr:subField",
    "transform": "cr:transform",
}
"""As the standard gives it, so that short names mean what they mean in it."""

_TYPES = {
    "string": "sc:Text", "bool": "sc:Boolean", "double": "sc:Float", "float": "sc:Float",
    "int64": "sc:Integer", "int32": "sc:Integer", "int8": "sc:Integer",
}  # fmt: skip


def croissant(chosen: Selection, store: EvidenceStore) -> dict[str, Any]:
    """The description of the files of a store, one set of records for each.

    Licence, creator and address are not known here, and left to who publishes.

    Args:
        chosen: the records that are in it.
        store: in the folder ``evidence`` of the data set.
    """
    newest = max(chosen.values("wall_end"))
    return {
        "@context": _CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": CONFORMS_TO,
        "name": f"{chosen.distinct('run_id')[0]}-evidence",
        "description": f"{len(chosen.ids)} evidence records of integ-gym: one episode in a row, "
        "with its discretization, policy, outcome, energy ledger and, where there is one, trace.",
        "version": "1.0.0",
        "datePublished": f"{newest:%Y-%m-%d}",
        "isLiveDataset": False,
        "distribution": [_file(file) for file in store.files()],
        "recordSet": [_records(file) for file in store.files()],
    }


def _file(file: Path) -> dict[str, Any]:
    return {
        "@type": "cr:FileObject",
        "@id": file.name,
        "name": file.name,
        "contentUrl": f"{file.parent.name}/{file.name}",
        "contentSize": f"{file.stat().st_size} B",
        "encodingFormat": "application/x-parquet",
        "sha256": file_hash(file),
    }


def _records(file: Path) -> dict[str, Any]:
    fields = [_field(file, one) for one in check_schema(file)]
    return {
        "@type": "cr:RecordSet",
        "@id": file.stem,
        "name": file.stem,
        "description": f"Records of {file.stem}.",
        "key": {"@id": f"{file.stem}/record_id"},
        "field": fields,
    }


def _field(file: Path, column: Any) -> dict[str, Any]:
    kind, about = str(column.type), described(column)
    several = kind.startswith("list<")
    single = str(column.type.value_type) if several else kind
    said = [about["meaning"], about["unit"] and f"unit: {about['unit']}", about["frame"]]
    return {
        "@type": "cr:Field",
        "@id": f"{file.stem}/{column.name}",
        "name": column.name,
        "description": "; ".join(filter(None, said)),
        "dataType": _TYPES.get(single, "sc:DateTime"),
        **({"repeated": True} if several else {}),
        "source": {"fileObject": {"@id": file.name}, "extract": {"column": column.name}},
    }
