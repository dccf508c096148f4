"""Fits in one file: their numbers, the scene with the estimates, and the data as they are drawn."""

from __future__ import annotations

import os
from dataclasses import astuple
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from vofem.files.hdf5 import FIT, checked_group, mark_format, writing
from vofem.files.whole import target
from vofem.fitting import Fit
from vofem.fitting.fit import FitStart
from vofem.fitting.measured import Data, StoredData
from vofem.io.storage.records import decode, encoder, restored_scene, scene_record
from vofem.io.storage.tree import read_tree, write_tree
from vofem.scene import Scene
from vofem.sensitivities import Parameter

SUFFIXES = (".h5", ".hdf")

#: Version of the format. It is increased when this version could not read the new files.
FORMAT = 1

#: What is written as it is.
_NUMBERS = (
    "values", "offsets", "covariance", "not_identifiable", "residuals", "chi2", "until", "runs", "notes",
)  # fmt: skip


def save(fit: Fit, path: str | os.PathLike[str], *, overwrite: bool = False) -> Path:
    """Write a fit to one file; see `vofem.Fit.save`."""
    goal = target(path, SUFFIXES)
    # Functions of time in Python are stored at the times of the data.
    times = np.concatenate([np.zeros(1), *(one.places for one in fit.data if one.along == "time [s]")])
    record = {
        **{name: getattr(fit, name) for name in _NUMBERS},
        "scene": scene_record(fit.scene, np.empty((fit.scene.model.system.size, 0)), times),
        "parameters": [_parameter(one, fit.scene) for one in fit.parameters],
        "starts": [astuple(start) for start in fit.starts],
        "data": [_data(one, fit.until) for one in fit.data],
    }
    with writing(goal, overwrite=overwrite) as blocks:
        group = blocks.file.create_group(FIT, track_order=True)
        mark_format(group, FORMAT)
        write_tree(group, record, encoder(times))
    return goal


def read(file: h5py.File, scene: Scene | None = None) -> Fit:
    """Return the fit in a file that is open; see `vofem.load`."""
    record = read_tree(checked_group(file, (FIT,), FORMAT, "a fit"), decode)
    scene = restored_scene(record["scene"], scene, "load", "file")
    things = (*scene.bodies, *scene.effects)
    parameters = [
        Parameter([things[k] for k in places], field, element=elements, bounds=bounds)
        for places, field, elements, bounds in record["parameters"]
    ]
    return Fit(
        tuple(parameters),
        tuple(StoredData(places=one.pop("where"), **one) for one in record["data"]),
        scene,
        tuple(FitStart(*start) for start in record["starts"]),
        **{name: record[name] for name in _NUMBERS},
    )


def _parameter(parameter: Parameter, scene: Scene) -> tuple[Any, ...]:
    """Return the places of the targets in bodies and effects, and the arguments of a parameter."""
    things = (*scene.bodies, *scene.effects)
    places = [next(k for k, thing in enumerate(things) if thing is found) for found in parameter.found(scene)]
    return places, parameter.field, parameter.elements, parameter.bounds


def _data(data: Data, until: float) -> dict[str, Any]:
    """Return what a file keeps of data: the arguments of `StoredData`."""
    return {
        "described": data.describe(),
        "values": data.values,
        "noise": data.noise,
        "offset": data.offset,
        "times": data.times,
        "unit": data.unit,
        "along": data.along,
        "where": data.places,
        "within": data.used(until),
    }
