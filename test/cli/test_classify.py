"""`classify` on poses that other programs wrote."""

import json

import numpy as np


def test_tolerance_changes_the_clusters(run, tmp_path):
    rows = [f'{np.sin(angle / 2)},0,0,{np.cos(angle / 2)}' for angle in np.radians([0, 6])]
    (tmp_path / 'p.csv').write_text('\n'.join(['qx,qy,qz,qw', *rows]) + '\n')
    for tolerance, clusters in ((), 2), (('--tolerance', 6.1), 1):
        ended = run('classify', 'p.csv', *tolerance, '--json')
        assert (ended.returncode, ended.stderr) == (0, '')
        assert len(json.loads(ended.stdout)['clusters']) == clusters
