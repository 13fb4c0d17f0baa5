"""What `resting_aspects drop` does: drop a part here and now, without ROS."""

import argparse
import csv
import dataclasses
import sys
import time
import uuid
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from resting_aspects_ros.commands.options import (
    check_output,
    conditions_of,
)
from resting_aspects_ros.commands.progress import DropProgress
from resting_aspects_ros.config_files import parts_folder, surfaces_file
from resting_aspects_ros.core.aspects import find_aspects
from resting_aspects_ros.core.distribution import (
    METHOD,
    Distribution,
    count_poses,
    no_drops,
)
from resting_aspects_ros.core.errors import InvalidValueError
from resting_aspects_ros.core.part import Part, load_part
from resting_aspects_ros.core.poses import DecidedBy, RestingPoses, RestStatus
from resting_aspects_ros.drops.campaign import default_workers, make_pool, stop_pool, submit_drops
from resting_aspects_ros.drops.part_library import PartLibrary, read_part_yaml
from resting_aspects_ros.drops.plan import plan_run
from resting_aspects_ros.drops.run import RunDescription
from resting_aspects_ros.drops.surfaces import Surfaces

INTERRUPTED = 130
POSES_HEADER = (
    'drop', 'x', 'y', 'z', 'qx', 'qy', 'qz', 'qw', 'status', 'decided_by', 'time_to_rest'
)  # fmt: skip


def drop_here(arguments: argparse.Namespace) -> int:
    """Drop, count and show; returns the exit code. Raises RestingAspectsError for wrong input."""
    part = _part(arguments)
    surfaces = Surfaces.read(surfaces_file())
    job, described = plan_run(
        part,
        conditions_of(arguments, surfaces),
        seed=arguments.seed,
        drops=arguments.drops,
        run_id=uuid.uuid4().hex[:12],
        started=time.time_ns(),
    )
    workers = default_workers() if arguments.workers is None else arguments.workers
    check_output('--poses', arguments.poses)
    for warning in part.warnings:
        print(f'warning: {warning}', file=sys.stderr)
    distribution = no_drops(find_aspects(part))
    interrupted = False
    with ExitStack() as stack:
        pool = make_pool(workers)
        stack.callback(stop_pool, pool)
        writers = [stack.enter_context(_poses_file(path)) for path in _pose_paths(arguments)]
        progress = stack.enter_context(DropProgress(part.name, arguments.drops))
        try:
            for future in submit_drops(job, 0, arguments.drops, pool, 2 * workers):
                poses = future.result()
                distribution += count_poses(distribution.aspects, poses)
                for writer in writers:
                    writer.writerows(_rows(poses))
                progress.update(distribution.drops)
        except KeyboardInterrupt:
            interrupted = True
    _answer(arguments, part, described, distribution, interrupted)
    return INTERRUPTED if interrupted else 0


def _part(arguments: argparse.Namespace) -> Part:
    """A mesh file if it looks like one, with the YAML beside it; else a named part."""
    given = Path(arguments.part)
    if given.suffix or len(given.parts) > 1:
        sheet = given.with_suffix('.yaml')
        values = read_part_yaml(sheet) if sheet.is_file() else {}
        if arguments.unit is not None:
            if values:
                raise InvalidValueError(f'--unit is {arguments.unit!r}, but {sheet} has the unit')
            values['unit'] = arguments.unit
        return load_part(given, **values)
    if arguments.unit is not None:
        raise InvalidValueError(f'--unit is for mesh files; that of {given} is in its YAML')
    return PartLibrary(arguments.parts or parts_folder()).load(arguments.part)


def _pose_paths(arguments: argparse.Namespace) -> list[Path]:
    paths = [] if arguments.poses is None else [arguments.poses]
    if arguments.out is not None:
        arguments.out.mkdir(parents=True, exist_ok=True)
        paths.append(arguments.out / 'poses.csv')
    return paths


@contextmanager
def _poses_file(path: Path) -> Iterator[Any]:
    with path.open('w', newline='', encoding='utf-8') as file:
        writer = csv.writer(file)
        writer.writerow(POSES_HEADER)
        yield writer


def _rows(poses: RestingPoses) -> Iterator[tuple[Any, ...]]:
    """In full precision: Python prints the shortest text that reads back as the same number."""
    for k in range(len(poses)):
        yield (
            poses.first_drop + k,
            *poses.position[k].tolist(),
            *poses.orientation[k].tolist(),
            RestStatus(poses.status[k]).name,
            DecidedBy(poses.decided_by[k]).name,
            float(poses.time_to_rest[k]),
        )


def _answer(
    arguments: argparse.Namespace,
    part: Part,
    described: RunDescription,
    distribution: Distribution,
    interrupted: bool,
) -> None:
    from resting_aspects_ros.report.document import distribution_document, to_json

    fields = dataclasses.asdict(described)
    fields.update(mesh_sha256=part.mesh_sha256, method=METHOD, complete=not interrupted)
    document = distribution_document(distribution, fields)
    if arguments.out is not None:
        from resting_aspects_ros.report.picture import save_picture

        (arguments.out / 'distribution.json').write_text(to_json(document), encoding='utf-8')
        save_picture(distribution, part, arguments.out / 'distribution.png', _title(described))
    if arguments.json:
        print(to_json(document), end='')
        return
    from rich.console import Console

    from resting_aspects_ros.report.table import distribution_table

    Console().print(distribution_table(distribution, _title(described)))
    if interrupted:
        print(
            f'interrupted after {distribution.drops} of {described.drops} drops', file=sys.stderr
        )
    if arguments.out is not None:
        print(f'{arguments.out}: distribution.json, distribution.png, poses.csv')


def _title(run: RunDescription) -> str:
    surface = run.conditions.surface or 'own conditions'
    return f'{run.part}, {run.drops} drops on {surface}, seed {run.seed}'
