"""What the analytic methods cost, and quasi_static beside trimesh's stable poses."""

from functools import partial

import trimesh
from bench_geometry import CORNERS, REPEATS, best, egg, prism
from bench_report import Section, Table
from dropper import ROOT
from rich.progress import track

from resting_aspects_ros.core.aspects.aspect import find_aspects
from resting_aspects_ros.core.estimators.estimate import METHODS, estimate
from resting_aspects_ros.core.estimators.resting_shape import NotDefinedError, RestingShape
from resting_aspects_ros.core.part import Part
from resting_aspects_ros.simulation.part_library import PartLibrary

PART = 'l_bracket'
MIDDLE = 200


def estimators() -> Section:
    """Time them."""
    parts = {PART: PartLibrary(ROOT / 'config' / 'parts').load(PART)}
    parts |= {f'egg of {n} corners': egg(n) for n in (MIDDLE, CORNERS)}
    parts[f'prism of {CORNERS} corners'] = prism(CORNERS)
    table = Table(['part', 'aspects (s)', 'all methods (s)', 'quasi_static (s)', 'trimesh (s)'])
    found: dict[str, dict[str, float]] = {}
    for name, part in track(list(parts.items()), 'estimators', transient=True):
        times = {
            'aspects_s': best(partial(find_aspects, part)),
            'all_methods_s': best(partial(_all, part)),
            'quasi_static_s': best(partial(_one, part)),
            'trimesh_s': best(partial(_trimesh, part)),
        }
        found[name.replace(' ', '_')] = times
        table.rows.append([name, *(f'{seconds:.4f}' for seconds in times.values())])
    note = (
        f'Times are the best of {REPEATS} runs. *Aspects*: including the symmetry of the solid. '
        f'*All methods*: {", ".join(METHODS)}, including the aspects of the part. '
        '*quasi_static*: this method alone, including the aspects. *trimesh*: '
        '`compute_stable_poses` of the same hull; it does not merge facets into aspects.'
    )
    return Section('Estimators', note, [table], {'estimators': found})


def _all(part: Part) -> None:
    shape = RestingShape(part)
    for method in METHODS:
        try:
            estimate(shape, method)
        except NotDefinedError:
            continue


def _one(part: Part) -> None:
    estimate(RestingShape(part), 'quasi_static')


def _trimesh(part: Part) -> None:
    hull = trimesh.convex.convex_hull(part.hull_vertices)
    trimesh.poses.compute_stable_poses(hull, center_mass=part.centre_of_mass)
