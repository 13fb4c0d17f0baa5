"""Files of poses for `classify`: accepted spellings, and errors that name the wrong value."""

import json

import numpy as np
import pytest

from resting_aspects_ros.api.classify import read_pose_csv
from resting_aspects_ros.api.result import POSES_HEADER
from resting_aspects_ros.errors import InvalidValueError

# An orientation with four different numbers.
X, Y, Z, W = 0.1, -0.5, 0.7, 0.5
VALUES = {'x': X, 'y': Y, 'z': Z, 'w': W}


@pytest.fixture
def read(tmp_path):
    """Write a file with a content and read it."""

    def from_text(text):
        path = tmp_path / 'p.csv'
        path.write_bytes(text.encode('utf-8', 'surrogatepass'))
        return read_pose_csv(path, 1)

    return from_text


@pytest.mark.parametrize(
    'header',
    [
        'qw,qx,qy,qz',
        ' QX , qY,QZ,Qw',
        '"Quaternion W [-]",quaternion x,quaternion y,quaternion z',
        '\ufeffqx,qy,qz,qw',
    ],
)
def test_names_in_any_order_and_spelling(read, header):
    names = header.replace('"', '').replace('[-]', '').strip('\ufeff').split(',')
    row = ','.join(str(VALUES[name.strip().lower()[-1]]) for name in names)
    text = f'{header}\n{row}\n'
    for spelling in (text, text.replace(',', ';').replace('\n', '\r\n')):
        np.testing.assert_allclose(read(spelling).orientation, [[X, Y, Z, W]], rtol=1e-12)


def test_bare_x_y_z_are_positions_beside_named_quaternions(read):
    poses = read(f'x_mm,y_mm,z_mm,w,x,note,y,z\n9,8,7,{W},{X},"a, b",{Y},{Z}\n')
    np.testing.assert_allclose(poses.orientation, [[X, Y, Z, W]], rtol=1e-12)


def test_own_pose_file_reads_settled_and_counts_other_poses(read):
    rest = 'ENERGY,0.5,0.01,1'
    rows = [
        ','.join(POSES_HEADER),
        f'0,9,9,9,{X},{Y},{Z},{W},SETTLED,{rest}',
        f'1,9,9,9,{X},{Y},{Z},{W},UNSETTLED,{rest}',
        '2,nan,nan,nan,nan,nan,nan,nan,FAILED,STILLNESS,nan,0.0,0',
        '',
        f'3,9,9,9,0,0,0,-1, settled ,{rest}',
        f'4,9,9,9,{X},{Y},{Z},{W},LOST,{rest}',
    ]
    poses = read('\n'.join(rows))
    assert poses.orientation.tolist()[1] == [0, 0, 0, 1]
    assert (poses.index.tolist(), poses.line.tolist()) == ([0, 3], [2, 6])
    assert (poses.unsettled, poses.failed, poses.drops) == (2, 1, 5)


def test_numbers_as_other_programs_write_them(read):
    """A quaternion is normalised if its length is within a thousandth of 1."""
    poses = read('qx,qy,qz,qw\n+0.00E+00, -0.0 ,1e-9,.99901\n0,0,0,"-1.00099"\n\n,,,\n')
    np.testing.assert_allclose(poses.orientation, [[0, 0, 0, 1], [0, 0, 0, 1]], atol=1e-8)
    assert (poses.orientation[:, 3] >= 0).all()


GOOD = 'qx,qy,qz,qw\n0,0,0,1\n'


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        (f'{GOOD}0.6,0,0,0.7982', ['0.6, 0, 0, 0.7982', '0.998561', 'line 3']),
        (f'{GOOD}0,0,nan,1', ["qz 'nan'", 'line 3']),
        (f'{GOOD}0,0,1', ['columns 3', '4', 'line 3']),
        (f'{GOOD}0,' + 'long' * 100 + ',0,1', ["qy 'longlong", "longlong'", 'line 3']),
        ('qx,qy,qz,qw,Status\n0,0,0,1,ok\n', ["Status 'ok'", 'line 2', 'SETTLED']),
        ('x,y,z,qx,qy,qz,w\n', ['one column for w']),
        ('w,x,y,z,status\n1,0,0,0,FAILED\n', ['settled poses 0', 'at least 1']),
        ('qx,qy,qz,qw\n0,0,0,"' + 'long' * 50_000, ['CSV']),
        ('qx,qy,qz,qw\n0,0,0,\ud800', ['UTF-8']),
    ],
)
def test_error_names_line_and_value(read, tmp_path, text, said):
    with pytest.raises(InvalidValueError) as caught:
        read(text)
    for words in (repr(str(tmp_path / 'p.csv')), *said):
        assert words in str(caught.value)


def test_tolerance_changes_the_clusters(run, tmp_path):
    rows = [f'{np.sin(angle / 2)},0,0,{np.cos(angle / 2)}' for angle in np.radians([0, 6])]
    (tmp_path / 'p.csv').write_text('\n'.join(['qx,qy,qz,qw', *rows]) + '\n')
    for tolerance, clusters in (5.9, 2), (6.1, 1):
        ended = run('classify', 'p.csv', '--tolerance', tolerance, '--json')
        assert len(json.loads(ended.stdout)['clusters']) == clusters
