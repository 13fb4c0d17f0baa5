"""Files of poses: accepted spellings, and errors that name the wrong value."""

import numpy as np
import pytest

from resting_aspects_ros.api.classify import read_pose_csv
from resting_aspects_ros.api.result import POSES_HEADER
from resting_aspects_ros.errors import InvalidValueError

# An orientation with four different numbers.
X, Y, Z, W = 0.1, -0.5, 0.7, 0.5
LINE = {'x': f'{X}', 'y': f'{Y}', 'z': f'{Z}', 'w': f'{W}'}


@pytest.fixture
def read(tmp_path):
    """Write a file with a content and read it."""

    def from_text(text, at_least=1, encoding='utf-8'):
        path = tmp_path / 'p.csv'
        path.write_bytes(text.encode(encoding))
        return read_pose_csv(path, at_least)

    return from_text


@pytest.fixture
def refusal(read, tmp_path):
    """Return the error for a content; the file is called p.csv in it."""

    def words(text, at_least=1, **options):
        with pytest.raises(InvalidValueError) as caught:
            read(text, at_least, **options)
        path = repr(str(tmp_path / 'p.csv'))
        assert path in str(caught.value)
        return str(caught.value).replace(path, 'p.csv')

    return words


@pytest.mark.parametrize(
    'header',
    [
        'qx,qy,qz,qw',
        'qw,qx,qy,qz',
        'x,y,z,w',
        'w,x,y,z',
        ' QX , qY,QZ,Qw',
        'q_x,q_y,q_z,q_w',
        'quat_w,quat_x,quat_y,quat_z',
        'orientation.x,orientation.y,orientation.z,orientation.w',
        'pose.orientation.x,pose.orientation.y,pose.orientation.z,pose.orientation.w',
        'rot_z,rot_y,rot_x,rot_w',
        '"Quaternion W [-]",quaternion x,quaternion y,quaternion z',
        '\ufeffqx,qy,qz,qw',
    ],
)
@pytest.mark.parametrize('delimiter', [',', ';'])
@pytest.mark.parametrize('end', ['\n', '\r\n'])
def test_names_in_any_order_and_spelling(read, header, delimiter, end):
    names = header.replace('"', '').replace('[-]', '').strip('\ufeff').split(',')
    row = delimiter.join(LINE[name.strip().lower()[-1]] for name in names)
    poses = read(header.replace(',', delimiter) + end + row + end)
    np.testing.assert_allclose(poses.orientation, [[X, Y, Z, W]], rtol=1e-12)
    assert (poses.index.tolist(), poses.line.tolist(), poses.drops) == ([0], [2], 1)


def test_bare_x_y_z_are_positions_beside_named_quaternions(read):
    poses = read(f'x,y,z,qx,qy,qz,qw\n9,8,7,{X},{Y},{Z},{W}\n')
    np.testing.assert_allclose(poses.orientation, [[X, Y, Z, W]], rtol=1e-12)
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
    poses = read('qx,qy,qz,qw\n+0.00E+00, -0.0 ,1e-9,.9999\n0,0,0,"-1.0009"\n\n,,,\n')
    np.testing.assert_allclose(poses.orientation, [[0, 0, 0, 1], [0, 0, 0, 1]], atol=1e-8)
    np.testing.assert_allclose(np.linalg.norm(poses.orientation, axis=1), 1, rtol=1e-15)
    assert (poses.orientation[:, 3] >= 0).all()


@pytest.mark.parametrize('length', [0.99901, 1.00099])
def test_a_quaternion_is_normalised_within_a_thousandth(read, length):
    poses = read(f'qx,qy,qz,qw\n{0.6 * length},0,0,{0.8 * length}\n')
    np.testing.assert_allclose(poses.orientation, [[0.6, 0, 0, 0.8]], rtol=1e-12)


@pytest.mark.parametrize(
    ('row', 'says'),
    [
        ('0.6,0,0,0.7982', ['qx, qy, qz, qw 0.6, 0, 0, 0.7982 in', 'length is 0.998561']),
        ('0,0,0,0', ['qx, qy, qz, qw 0, 0, 0, 0 in', 'length is 0']),
        ('0,0,0,1.0011', ['qx, qy, qz, qw 0, 0, 0, 1.0011 in', 'length 1 within 0.001, and']),
        ('1e200,1e200,0,0', ['qx, qy, qz, qw 1e+200, ', 'length 1 within', 'length is inf']),
        ('0,0,nan,1', ["qz 'nan' in", 'a finite number, such as -0.5']),
        ('0,0,0,inf', ["qw 'inf' in", 'a finite number']),
        ('0,up,0,1', ["qy 'up' in", 'a finite number']),
        ('0,,0,1', ["qy '' in", 'a finite number']),
        ('0,0,1', ['number of columns 3 in', 'expected 4, as in the header']),
        ('0,0,0,1,0', ['number of columns 5 in', 'expected 4']),
        ('0;0;0;1', ['number of columns 1 in', 'expected 4']),
        ('0,' + 'long' * 100 + ',0,1', ["qy 'longlong", "longlong' in", 'a finite number']),
    ],
)
def test_error_names_line_and_value_of_a_wrong_pose(refusal, row, says):
    words = refusal(f'qx,qy,qz,qw\n0,0,0,1\n{row}\n0,0,0,1\n')
    assert words.startswith(f'invalid {says[0]}')
    for word in (*says, 'in p.csv line 3: expected'):
        assert word in words


def test_decimal_comma_is_refused(refusal):
    assert refusal('qx;qy;qz;qw\n0;0,6;0;0,8\n') == (
        "invalid qy '0,6' in p.csv line 2: expected a finite number, such as -0.5"
    )


def test_unknown_status_is_refused(refusal):
    assert refusal('qx,qy,qz,qw,Status\n0,0,0,1,ok\n') == (
        "invalid Status 'ok' in p.csv line 2: expected one of SETTLED, UNSETTLED, FAILED, LOST, "
        'SLIDING'
    )


@pytest.mark.parametrize(
    ('header', 'says'),
    [
        ('', 'no column is x or y or z or w of the quaternion'),
        ('x,y,z', 'no column is w of the quaternion'),
        ('x,y,z,qx,qy,qz,w', 'no column is w of the quaternion'),
        ('drop,qx,qz,qw', 'no column is y of the quaternion'),
        ('qx,qy,qz,qw,quat_w', 'several columns are w of the quaternion'),
        ('0.5,0.5,0.5,0.5', 'no column is x or y or z or w'),
        ('q1,q2,q3,q4', 'no column is x or y or z or w'),
        ('roll,pitch,yaw', 'no column is x or y or z or w'),
    ],
)
def test_header_without_complete_quaternion_is_refused(refusal, header, says):
    words = refusal(f'{header}\n')
    names = ', '.join(header.split(','))
    assert words.startswith(f'invalid column names {names!r} in p.csv line 1: {says}')
    assert words.endswith(
        '; expected qx, qy, qz, qw (or q_x, quat_x, orientation.x, ...) or x, y, z, w, in any '
        'order, in columns parted by , or ;'
    )


@pytest.mark.parametrize(
    ('text', 'at_least', 'says'),
    [
        ('w,x,y,z\n', 1, 'invalid number of poses 0 in p.csv: expected at least 1'),
        ('w,x,y,z\n1,0,0,0\n', 2, 'invalid number of poses 1 in p.csv: expected at least 2'),
        (
            'w,x,y,z,status\n1,0,0,0,FAILED\n',
            1,
            'invalid number of settled poses 0 in p.csv: expected at least 1',
        ),
    ],
)
def test_too_few_poses_are_refused(refusal, text, at_least, says):
    assert refusal(text, at_least) == says


@pytest.mark.parametrize(
    ('text', 'encoding', 'says'),
    [
        ('qx;qy;qz;qw;Größe\n', 'latin-1', 'is not text in UTF-8'),
        ('qx,qy,qz,qw\n0,0,0,1\n', 'utf-16', 'is not text in UTF-8'),
        ('qx,qy,qz,qw\n0,0,0,"' + 'long' * 50_000, 'utf-8', 'is not a CSV: field larger'),
    ],
)
def test_file_that_is_not_csv_is_refused(refusal, text, encoding, says):
    assert says in refusal(text, encoding=encoding)


@pytest.mark.parametrize(
    ('name', 'says'), [('nowhere.csv', 'does not exist'), ('.', 'is a folder')]
)
def test_unreadable_pose_file_is_refused(tmp_path, name, says):
    path = tmp_path / name
    with pytest.raises(InvalidValueError, match=says) as caught:
        read_pose_csv(path, 1)
    assert f'pose file {str(path)!r}' in str(caught.value)
