"""Validation of the feeder: forecasts against runs with camera, vision and controller."""

import dataclasses
from collections.abc import Iterator

import numpy as np
from rich.console import Console
from rich.progress import track

import resting_aspects_ros as ra
from resting_aspects_ros.api.forecast import forecast_controlled, forecast_from
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.feeding.control import (
    Choice,
    ControllerModel,
    SeenPart,
    advise,
    controller_model,
)
from resting_aspects_ros.feeding.footprint import Tray
from resting_aspects_ros.feeding.steady_state import CycleTimes
from resting_aspects_ros.feeding.tray_simulation import ControlledRuns, VirtualFeeder
from resting_aspects_ros.nodes.vision_example.contours import clearances, find_blobs
from resting_aspects_ros.vision.identification import identify, observed_polygon
from resting_aspects_ros.vision.rolling import Candidate, KnownPart
from resting_aspects_ros.vision.tray_image import OutlinePlaces, TrayCamera, render_tray
from validation.document import paragraphs, table

# Pickable classes of each part.
PARTS = {'l_bracket': (1,), 't_prism': (1,)}
TRAY = Tray((0.2, 0.2), 0.005)
TIMES = CycleTimes(robot=1.2, vibrate=0.5, settle=0.3, image=0.2)
DROPS, PER_ASPECT, SEED = 300, 40, 1
PX_PER_MM, BLUR, NOISE, LEVEL, MIN_AREA = 5.0, 0.7, 4.0, 127.5, 1.0


@dataclasses.dataclass(frozen=True)
class CellRun:
    """What a run has done."""

    picks: int
    missed: int
    seconds: float
    blocked: float  # share of the parts in the images that were not recognised

    @property
    def rate(self) -> float:
        """Parts per minute."""
        return 60 * self.picks / self.seconds


def run_cell(known: KnownPart, model: ControllerModel, seed: int, minutes: float) -> CellRun:
    """Run a feeder with camera, vision and controller on a tray that is empty at first."""
    of_tray, of_noise = (np.random.default_rng([seed, k]) for k in range(2))
    camera = TrayCamera(TRAY.size, PX_PER_MM)
    places = OutlinePlaces(known.outlines, TRAY.size, of_tray)
    feeder = VirtualFeeder(model, places, of_tray)
    missed = seen_parts = unknown = 0
    while feeder.seconds < 60 * minutes:
        image = render_tray(places.polygons, camera, of_noise, blur=BLUR, noise=NOISE)
        found, seen = look(image, camera, known)
        seen_parts += len(seen)
        unknown += sum(part.symmetry_class == 0 for part in seen)
        advice = advise(seen, model)
        feeder.take_image()
        for k in advice.picks:
            best = found[k]
            assert best is not None
            outline = known.outlines[best.symmetry_class - 1]
            cos, sin = np.cos(best.yaw), np.sin(best.yaw)
            x, y = np.array([[cos, -sin], [sin, cos]]) @ outline.centroid + (best.x, best.y)
            if not feeder.pick(x, y, best.symmetry_class):
                missed += 1
                break
        else:
            action = advice.then if advice.choice is Choice.PICK else advice.choice
            if action is not None:
                feeder.move(action, advice.supply)
    return CellRun(feeder.picks, missed, feeder.seconds, unknown / max(seen_parts, 1))


def look(
    image: np.ndarray, camera: TrayCamera, known: KnownPart
) -> tuple[list[Candidate | None], list[SeenPart]]:
    """Return what vision_example and feeder_controller make of an image."""
    to_tray = camera.model.to_tray
    blobs = find_blobs(image, LEVEL, MIN_AREA * camera.px_per_mm**2)
    outers = [to_tray(blob.outer) for blob in blobs]
    apart = clearances([to_tray(blob.boundary) for blob in blobs])
    found, seen = [], []
    for blob, outer, free in zip(blobs, outers, apart.tolist(), strict=True):
        holes = [to_tray(hole) for hole in blob.holes]
        try:
            each = identify(observed_polygon({'outer': outer, 'holes': holes}), [known])
        except InvalidValueError:  # parts that touch at a thin neck, whose contour crosses itself
            each = None
        best = each.best if each is not None else None
        found.append(best)
        seen.append(
            SeenPart(0, 0.0, 0.0)
            if best is None
            else SeenPart(best.symmetry_class, free, best.posterior)
        )
    return found, seen


def feeder(seeds: int, minutes: float) -> Iterator[str]:
    """Compare runs of each part with the prediction interval of its forecast."""
    yield from paragraphs(
        '## Feeder',
        f'Runs of {minutes:g} minutes in simulated time, beginning with an empty tray, with '
        f'{seeds} seeds for each part: rendered images with noise, contours, identification, '
        'decision, and a robot that picks the part at the detected place. The outlines themselves '
        f'are placed on the tray. Model: {DROPS} drops and {PER_ASPECT} flips from each aspect, '
        'which are taken as the truth. The forecast is that of `forecast_controlled`. *Within*: '
        'runs in the 95 % prediction interval; at least 17 of 20 are required.',
    )
    rows = []
    for name, classes in PARTS.items():
        known, model, forecast = prepared(name, classes, minutes)
        runs = [
            run_cell(known, model, seed, minutes)
            for seed in track(range(1, seeds + 1), name, console=Console(stderr=True))
        ]
        rates = np.array([run.rate for run in runs])
        low, high = forecast.prediction
        inside = int(((rates >= low) & (rates <= high)).sum())
        expected = forecast.rate
        error = 100 * rates.std(ddof=1) / np.sqrt(len(rates)) / expected
        missed = sum(run.missed for run in runs)
        rows.append(
            [
                f'{name}, {", ".join(map(str, classes))}',
                f'{expected:.2f}',
                f'{low:.2f} to {high:.2f}',
                f'{rates.mean():.2f}',
                f'{100 * (rates.mean() / expected - 1):+.1f} ± {error:.1f} %',
                f'{inside} of {seeds}',
                f'{missed} of {sum(run.picks for run in runs) + missed}',
                f'{100 * np.mean([run.blocked for run in runs]):.2f} %',
            ]
        )
    columns = ['part, pickable classes', 'forecast', 'prediction interval', 'mean of the runs']
    columns += ['difference', 'within', 'missed picks', 'not recognised']
    yield from table(columns, rows)


def prepared(
    name: str, classes: tuple[int, ...], minutes: float
) -> tuple[KnownPart, ControllerModel, ControlledRuns]:
    """Return a part, the model of its controller, which is also the truth, and its forecast."""
    result = ra.reorient(name, 'flip', PER_ASPECT, drops=DROPS, seed=SEED)
    ids = result.matrix.aspects.chosen(None, classes, 'pickable')
    forecast = forecast_from(result, ids, TRAY, TIMES, minutes=minutes)
    known = ra.known_part(name, result.drop)
    return known, controller_model(forecast.named.model), forecast_controlled(forecast)
