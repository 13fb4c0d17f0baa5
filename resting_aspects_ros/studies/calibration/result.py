"""The result of a calibration: as text, JSON, an entry of a surfaces file, and a picture."""

import dataclasses
import json
import math
from pathlib import Path
from typing import Any

from resting_aspects_ros.simulation.conditions import QUANTITIES, DropConditions
from resting_aspects_ros.simulation.surfaces import UNCERTAINTY
from resting_aspects_ros.studies.calibration.checks import Prediction
from resting_aspects_ros.studies.calibration.comparison import SurfaceComparison, compare_surfaces
from resting_aspects_ros.studies.calibration.fitted_surface import FittedSurface
from resting_aspects_ros.studies.calibration.summary import Estimate, discrepancy

SCHEMA_VERSION = 1
SAMPLES = 64  # of the posterior, in a surfaces file


class CalibrationResult(FittedSurface):
    """What counts say of a surface; its attributes are those of `FittedSurface`."""

    def compare(self, other: FittedSurface) -> SurfaceComparison:
        """Compare the surface with another one; see SurfaceComparison."""
        return compare_surfaces(self.fit, other.fit)

    def document(self) -> dict[str, Any]:
        """Return everything as plain values; see docs/reference/files.md."""
        given, fit = self.fit.given, self.fit
        mean, low, high = discrepancy(fit)
        return {
            'schema_version': SCHEMA_VERSION,
            'surface': self.surface,
            'source': given.source,
            'way': given.way,
            'conditions': _values(self.conditions),
            'estimates': [_estimate(each) for each in self.estimates],
            'discrepancy': {'mean': mean, 'low': low, 'high': high} if fit.discrepancy else None,
            'g_test': None if math.isnan(self.g_test.p) else dataclasses.asdict(self.g_test),
            'contradicted': self.contradicted,
            'parts': [
                {
                    'name': part.name,
                    'part_sha256': part.part.part_sha256,
                    'groups': dict(zip(part.names, map(list, part.groups), strict=True)),
                    'counts': part.counts.tolist(),
                    'prediction': _prediction(self.predictions[k]),
                    'left_out': _prediction(self.left_out[k]) if self.left_out else None,
                }
                for k, part in enumerate(given.parts)
            ],
            'left_out_deviation': self.left_out_deviation if self.left_out else None,
            'simulated_drops': fit.simulated_drops,
            'points': len(fit.points),
            'rounds': fit.rounds,
            'error_of_shares': fit.errors.tolist(),
            'dependence': fit.posterior.dependence,
            'forms': [each.text for each in fit.surrogates],
            'seed': self.seed,
            'draws': self.draws(),
        }

    def to_json(self) -> str:
        """Return the document as JSON."""
        return json.dumps(self.document(), indent=2) + '\n'

    def surface_entry(self, *, uncertainty: bool = True) -> str:
        """Return an entry for a surfaces file, with its source and perhaps its uncertainty."""
        from resting_aspects_ros.studies.calibration.texts import source_text, wrapped

        lines = [f'{self.surface}:']
        for name in QUANTITIES:
            lines.append(f'  {name}: {getattr(self.conditions, name)}')
            if name == 'height':
                lines.append(f'  height_of: {self.conditions.height_of.name}')
        lines.append('  source: >-')
        lines += [f'    {line}' for line in wrapped(source_text(self), 94)]
        samples = self.draws(SAMPLES) if uncertainty else []
        if not samples:
            return '\n'.join(lines) + '\n'
        lines.append(f'  {UNCERTAINTY}:  # equally probable; the k-th values belong together')
        for name in samples[0]:
            values = ', '.join(f'{each[name]:.3g}' for each in samples)
            lines += [
                f'    {name}: [',
                *(f'      {line}' for line in wrapped(values, 92)),
                '    ]',
            ]
        return '\n'.join(lines) + '\n'

    def save_picture(self, path: str | Path) -> None:
        """Write the picture as a PNG file."""
        from resting_aspects_ros.api.output_files import whole_file
        from resting_aspects_ros.report.figure_style import png_bytes
        from resting_aspects_ros.studies.calibration.figure import calibration_figure

        with whole_file(Path(path)) as file:
            file.write_bytes(png_bytes(calibration_figure(self)))

    def __str__(self) -> str:
        from resting_aspects_ros.studies.calibration.texts import result_text

        return result_text(self)


def _values(conditions: DropConditions) -> dict[str, Any]:
    found: dict[str, Any] = {name: getattr(conditions, name) for name in QUANTITIES}
    return {**found, 'height_of': conditions.height_of.name}


def _estimate(each: Estimate) -> dict[str, Any]:
    values = {k: v for k, v in vars(each).items() if k != 'factor'}
    factor = each.factor
    return {
        'name': factor.name,
        'unit': factor.unit,
        'range': [factor.low, factor.high],
        'logarithmic': factor.logarithmic,
        **values,
    }


def _prediction(each: Prediction) -> dict[str, Any]:
    arrays = {k: v.tolist() for k, v in vars(each).items()}
    return {**arrays, 'deviation': each.deviation, 'inside': each.inside}
