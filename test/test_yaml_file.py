"""YAML that users write: any defect is reported as one error in one line."""

import math
import string

import pytest
from hypothesis import given
from hypothesis import strategies as st

from resting_aspects_ros.errors import InvalidValueError, PartError
from resting_aspects_ros.input_files import parse_yaml, read_yaml, yaml_text

TAGS = ('int', 'float', 'bool', 'null', 'str', 'binary', 'timestamp', 'omap', 'pairs', 'set')
TAGS += ('seq', 'map', 'merge', 'value', 'python/name:os.system', 'nothing')
VALUES = ('', '""', 'abc', '0x', '-', '[]', '[1]', '{}', '{a: 1}', '2024-99-99', '1:99:x')


def bomb(depth, merge=False):
    """Each line stands for nine of the line before."""
    first, line = ('{k: 1}', '{{<<: [{}]}}') if merge else ('[1]', '[{}]')
    lines = [f'a0: &a0 {first}']
    lines += [f'a{k}: &a{k} {line.format(", ".join([f"*a{k - 1}"] * 9))}' for k in range(1, depth)]
    return '\n'.join(lines)


def error_of(document):
    """The message, in one line, with which a document is refused; empty if it is read."""
    try:
        parse_yaml(document, 'sheet')
    except InvalidValueError as error:
        message = str(error)
    else:
        return ''
    assert message.startswith('sheet is not valid YAML: ')
    assert message.isprintable()
    return message


@pytest.mark.parametrize(
    ('text', 'value'),
    [
        ('1e-6', 1e-6), ('-2E+3', -2000.0), ('.5', 0.5), ('5.', 5.0), ('-.inf', -math.inf),
        ('-3', -3), ('0x10', 16), ('1_000', 1000), ('5:50', '5:50'), ('20:30.5', '20:30.5'),
        ('010', '010'), ('e5', 'e5'), ('1e', '1e'), ('.', '.'),
    ],
)  # fmt: skip
def test_numbers_are_those_of_yaml_1_2(text, value):
    """A range such as 5:50 is text, not a number of base 60; 1e-6 is a number."""
    found = parse_yaml(f'a: {text}', 'sheet')['a']
    assert (found, type(found)) == (value, type(value))
    assert math.isnan(parse_yaml('.nan', 'sheet'))


@pytest.mark.parametrize('text', ['a: 1\nb: 2\na: 3', '\n\n[{a: 1, ? a : 3}]'])
def test_key_that_occurs_twice_is_refused_and_named(text):
    assert error_of(text).endswith("the key 'a' occurs twice, again in line 3")


def test_value_that_does_not_fit_its_tag_is_an_error():
    places = ('mass: {}', '{}', '? {}\n: 1')
    for tag in TAGS:
        texts = [place.format(f'!!{tag} {value}') for value in VALUES for place in places]
        assert any(error_of(text) for text in texts), tag


@pytest.mark.parametrize(
    'text',
    [
        '[' * 1500,
        bomb(20),
        bomb(20, merge=True),
        'a: &a {b: *a}',
        'a: ' + '9' * 5000,
        '--- 1\n--- 2\n',
        '\x00',
        b'\xff\xff',
        '? [1, 2]\n: 3',
    ],
    ids=lambda text: repr(text[:20]),
)
def test_hostile_documents_are_rejected_in_one_line(text):
    with pytest.raises(PartError, match=r'^sheet is not valid YAML: ') as caught:
        parse_yaml(text, 'sheet', PartError)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 400


def test_a_file_is_read_and_named_in_errors(tmp_path):
    file = tmp_path / 'a.yaml'
    file.write_text('a: [1, 2]')
    assert read_yaml(file, 'sheet') == {'a': [1, 2]}
    file.write_text('a: !!timestamp abc')
    with pytest.raises(InvalidValueError, match=r"^sheet '.*a\.yaml' is not valid YAML: "):
        read_yaml(file, 'sheet')
    file.write_text('a: 1' + '#' * 70000)
    with pytest.raises(InvalidValueError, match='too large: expected at most 64 KiB'):
        read_yaml(file, 'sheet')


@given(st.text(string.hexdigits + 'xo_:+-.', max_size=14))
def test_text_is_read_as_it_was_written(text):
    for value in (text, '547775e40049', '0x1f', '12', '1.5', 'null'):
        assert parse_yaml(yaml_text({'run_id': value}), 'sheet') == {'run_id': value}
