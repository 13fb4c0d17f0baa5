"""The Python in README.md and the pages of docs that needs no ROS graph is run here."""

import pytest
from doc_pages import code, code_blocks, first_cells, section

import resting_aspects_ros as ra
from resting_aspects_ros import client

REFERENCE = 'docs/reference/python.md'


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    """Run code in an empty folder, in one namespace; returns what it printed."""
    monkeypatch.chdir(tmp_path)
    namespace = {}

    def run(text, page):
        exec(compile(text, page, 'exec'), namespace)
        return capsys.readouterr().out

    return run


@pytest.mark.slow
@pytest.mark.parametrize('name', ['python', 'camera_to_robot'])
def test_the_tutorial_prints_what_it_shows(run, name):
    page, printed = f'docs/tutorials/{name}.md', ''
    for language, text in code_blocks(page, 'python', 'text'):
        if language == 'python':
            assert printed == '', 'the page shows no output of the block before'
            printed = run(text, page)
        else:
            assert printed == text
            printed = ''
    assert printed == ''


@pytest.mark.slow
def test_the_example_of_the_readme_runs(run, tmp_path):
    (text,) = [text for text in code('README.md', 'python') if 'ra.drop' in text]
    assert '(1000, 3)' in run(text, 'README.md')
    assert (tmp_path / 'out' / 'l_bracket' / 'report.html').is_file()


def test_the_numbers_of_the_page_on_trust(run):
    (text,) = code('docs/explanation/trust.md', 'python')
    (shown,) = [each for each in code('docs/explanation/trust.md', 'text') if 'counted' in each]
    assert run(text, 'trust.md') == shown


@pytest.mark.slow
@pytest.mark.parametrize(
    ('page', 'more', 'said'),
    [
        ('choose_conditions', 'print(result.run.conditions)', ['friction=0.3', 'restitution=0.6']),
        (
            'calibrate',
            '',
            ['oak_table: 1 part, 200 counted drops', 'oak_table:\n  height: 0.06\n'],
        ),
    ],
)
def test_example_of_a_guide(run, page, more, said):
    (text,) = code(f'docs/how_to/{page}.md', 'python')
    printed = run(f'{text}\n{more}', page)
    assert all(words in printed for words in said)


@pytest.mark.parametrize('module', [ra, client], ids=lambda module: module.__name__)
def test_every_public_name_is_listed(module):
    listed = first_cells(section(REFERENCE, f'## {module.__name__}'))
    assert listed == [f'`{name}`' for name in module.__all__]
