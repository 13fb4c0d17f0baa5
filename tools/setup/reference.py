"""Write what the reference pages and the parameter file take from the declarations in the code.

    PYTHONPATH=tools .venv/bin/python tools/setup/reference.py [--check]

In docs/reference, what is between `<!-- generated: NAME -->` and `<!-- end -->` is replaced: the
commands and their flags, the keys of conditions and actions, the parameters of the nodes, and the
types of messages. `config/resting_aspects.yaml` is written as a whole. With --check nothing is
written, and the exit code is 1 if a file would change.
"""

import argparse
import re
import sys
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import MISSING, fields
from importlib import import_module
from pathlib import Path
from typing import Any

import yaml

from resting_aspects_ros.cli.main import make_parser
from resting_aspects_ros.cli.verbs import COMMANDS, GROUPS
from resting_aspects_ros.simulation.actions import KINDS
from resting_aspects_ros.simulation.conditions import QUANTITIES, HeightOf, quantities_of

ROOT = Path(__file__).resolve().parents[2]
REFERENCE = ROOT / 'docs' / 'reference'
INTERFACES = ROOT / 'resting_aspects_interfaces'
PARAMETER_FILE = ROOT / 'config' / 'resting_aspects.yaml'
NODES = (
    'drop_simulator',
    'aspect_classifier',
    'drop_recorder',
    'feeder_controller',
    'camera_simulator',
    'vision_example',
    'log_replayer',
)
# Groups of flags that several commands have: the title in the help, the section of the page, and a
# command that has them.
SHARED = {
    'conditions of the drops': ('Conditions', 'drop'),
    'conditions of the contact': ('Conditions of the contact', 'reorient'),
    'surroundings, instead of a level plane': ('Surroundings', 'drop'),
    'time of the action': ('Values of an action', 'reorient'),
}
ACTION = 'values of the action '
# Flags that many commands have together, by the section that lists them.
COMMON = {
    'Part': ('--unit', '--body', '--parts'),
    'Workers': ('--workers', '--scheduler'),
    'Output': ('--json', '--table'),
}
HEADER = """\
# ROS parameter file with the default of every parameter of every node, for any namespace.
#   ros2 launch resting_aspects_ros resting_aspects.launch.py params_file:=my_copy.yaml
#   resting_aspects nodes --ros-args --params-file my_copy.yaml
# Parameters marked "any time" can be set while the node runs, the others only at its start.
# `make reference` writes this file.
"""


def table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table in Markdown."""
    lines = [headings, ['---'] * len(headings), *rows]
    marks = ['| ' + ' | '.join(line) + ' |' for line in lines]
    marks[1] = marks[1].replace(' ', '')
    return '\n'.join(marks)


def plain(text: str) -> str:
    """Return a text that a cell shows as it is."""
    return ' '.join(text.split()).replace('|', '\\|').replace('<', '&lt;')


# -- Commands -------------------------------------------------------------------------------------


def parser_of(command: str) -> argparse.ArgumentParser:
    """Return the parser of a command."""
    parser = make_parser([command])
    (choices,) = [a for a in parser._actions if isinstance(a, argparse._SubParsersAction)]  # noqa: SLF001
    found = choices.choices[command]
    assert isinstance(found, argparse.ArgumentParser)
    return found


def flag_rows(actions: Iterable[argparse.Action]) -> list[tuple[str, str]]:
    """Return the flag, or the name of an argument, and the meaning of each action."""
    rows = []
    for action in actions:
        value = action.metavar
        if value is None and action.choices is not None:
            value = '{' + ','.join(map(str, action.choices)) + '}'
        if action.nargs == argparse.REMAINDER:
            value = '...'
        shown = f'[{value}]' if action.nargs == '?' and action.option_strings else value
        name = ' '.join([*action.option_strings, *([str(shown)] if shown else [])])
        rows.append((f'`{name}`', plain((action.help or '').replace('%%', '%'))))
    return rows


def own_and_shared(command: str) -> tuple[list[argparse.Action], list[str]]:
    """Return the actions that a command does not share, and the sections of the others."""
    own: list[argparse.Action] = []
    sections: list[str] = []
    for group in parser_of(command)._action_groups:  # noqa: SLF001
        title = group.title or ''
        if title in SHARED or title.startswith(ACTION):
            sections.append(SHARED.get(title, ('Values of an action', ''))[0])
        else:
            own += [a for a in group._group_actions if a.dest != 'help']  # noqa: SLF001
    found = []
    for section, flags in COMMON.items():
        if {flag for action in own for flag in action.option_strings}.issuperset(flags):
            own = [action for action in own if not set(flags) & set(action.option_strings)]
            found.append(section)
    return own, list(dict.fromkeys([*found, *sections]))


def command_text(command: str) -> str:
    """Return the table of the arguments of a command, and where those are that it shares."""
    own, sections = own_and_shared(command)
    parts = [table(('argument', 'meaning'), flag_rows(own))] if own else []
    if sections:
        links = [f'[{each}](#{each.lower().replace(" ", "-")})' for each in sections]
        parts.append(f'It also takes the flags of {", ".join(links)}.')
    return '\n\n'.join(parts) or 'It has no flags.'


def shared_flags(title: str, command: str) -> str:
    """Return the table of the flags of a group of a command.

    Below it are the values of an action that have the flag of another kind.
    """
    groups = parser_of(command)._action_groups  # noqa: SLF001
    (found,) = [group for group in groups if group.title == title]
    rows = flag_rows(found._group_actions)  # noqa: SLF001
    parts = [table(('flag', 'meaning'), rows)] if rows else []
    if title.startswith(ACTION) and found.description:
        parts.append(plain(found.description))
    return '\n\n'.join(parts)


def command_blocks() -> dict[str, str]:
    """Return the generated texts of the page of commands, by name."""
    rows = [
        ('' if k else title, f'[`{name}`](#{name})', text)
        for title, group in GROUPS.items()
        for k, (name, text) in enumerate(group.items())
    ]
    actions = parser_of('drop')._actions  # noqa: SLF001
    common = {
        section: [action for action in actions if set(action.option_strings) & set(flags)]
        for section, flags in COMMON.items()
    }
    return {
        'commands': table(('', 'command', 'what it does'), rows),
        **{
            f'common flags {section}': table(('flag', 'meaning'), flag_rows(found))
            for section, found in common.items()
        },
        **{
            f'flags of {title}': shared_flags(title, command)
            for title, (_, command) in SHARED.items()
        },
        **{f'flags of {kind}': shared_flags(f'{ACTION}{kind}', 'reorient') for kind in KINDS},
        **{name: command_text(name) for name in COMMANDS},
    }


def with_all_commands(page: str) -> str:
    """Return the page of commands with a section for each command that has none."""
    for name in COMMANDS:
        if f'<!-- generated: {name} -->' not in page:
            module = import_module(f'resting_aspects_ros.cli.verbs.{name}')
            text = textwrap.fill(' '.join(module.DESCRIPTION.split()), 120)
            page += f'\n## {name}\n\n{text}\n\n<!-- generated: {name} -->\n<!-- end -->\n'
    return page


# -- Files, parameters and types ------------------------------------------------------------------


def default_text(kind: Any, name: str) -> str:
    """Return the default of a value of an action, or that it is required."""
    (declared,) = [each for each in fields(kind) if each.name == name]
    if declared.default is MISSING:
        return 'required'
    return '' if declared.default is None else f'{declared.default:g}'


def file_blocks() -> dict[str, str]:
    """Return the generated texts of the page of files, by name."""
    conditions = [
        (f'`{name}`', each.allowed(), plain(each.text)) for name, each in QUANTITIES.items()
    ]
    heights = ', '.join(each.name for each in HeightOf)
    conditions.append(('`height_of`', heights, 'reference point of `height`'))
    return {
        'conditions': table(('key', 'allowed', 'meaning'), conditions),
        **{
            f'keys of {kind}': table(
                ('key', 'allowed', 'default', 'meaning'),
                [
                    (f'`{name}`', each.allowed(), default_text(action, name), plain(each.text))
                    for name, each in quantities_of(action).items()
                ],
            )
            for kind, action in KINDS.items()
        },
    }


def parameters_of(node: str) -> list[Any]:
    """Return the declared parameters of a node."""
    return list(import_module(f'resting_aspects_ros.nodes.{node}.node').PARAMETERS)


def meaning(parameter: Any) -> str:
    """Return the description of a parameter, with its bounds."""
    parts = [parameter.description]
    if parameter.bounds is not None:
        parts.append('{:g} to {:g}'.format(*parameter.bounds))
    if parameter.allowed:
        parts.append(parameter.allowed)
    return '; '.join(parts)


def parameter_blocks() -> dict[str, str]:
    """Return the generated text of the page of parameters, by name."""
    rows = []
    for node in NODES:
        for k, each in enumerate(parameters_of(node)):
            default = each.default
            rows.append(
                (
                    '' if k else f'`{node}`',
                    f'`{each.name}`{" *" if each.changeable else ""}',
                    str(default).lower() if isinstance(default, bool) else str(default),
                    plain(meaning(each)),
                )
            )
    return {'parameters': table(('node', 'parameter', 'default', 'meaning'), rows)}


def parameter_file() -> str:
    """Return the text of the file with the defaults of all parameters."""
    parts = [HEADER]
    for node in NODES:
        lines = [f'/**/{node}:', '  ros__parameters:']
        for each in parameters_of(node):
            text = meaning(each)
            note = f'{text[0].upper()}{text[1:]}.{" Any time." if each.changeable else ""}'
            lines += textwrap.wrap(note, 99, initial_indent='    # ', subsequent_indent='    # ')
            value = yaml.safe_dump(each.default, default_flow_style=True).split('\n')[0]
            lines.append(f'    {each.name}: {value}')
        parts.append('\n'.join(lines) + '\n')
    return '\n'.join(parts)


def type_blocks() -> dict[str, str]:
    """Return the generated text of the page of the ROS interface, by name."""
    rows = []
    for kind in ('action', 'msg', 'srv'):
        for path in sorted((INTERFACES / kind).glob('*')):
            comment = re.match(r'(?:#.*\n)*', path.read_text(encoding='utf-8'))
            assert comment, path
            text = ' '.join(line.lstrip('# ') for line in comment[0].splitlines())
            first = re.split(r'(?<=[.:])\s', text, maxsplit=1)[0].rstrip('.:')
            place = f'../../resting_aspects_interfaces/{kind}/{path.name}'
            rows.append((f'[{kind}/{path.stem}]({place})', plain(first)))
    return {'types': table(('type', 'content'), rows)}


# -- Pages ----------------------------------------------------------------------------------------


def replaced(page: str, blocks: dict[str, str], place: Path) -> str:
    """Return a page with its generated texts; raises ValueError if names do not agree."""
    names = re.findall(r'<!-- generated: (.+?) -->', page)
    if sorted(names) != sorted(blocks):
        different = sorted(set(names) ^ set(blocks))
        raise ValueError(f'invalid blocks {different} of {place}: expected each of them once')
    pattern = re.compile(r'(<!-- generated: (.+?) -->\n).*?(<!-- end -->)', re.DOTALL)
    return pattern.sub(lambda m: f'{m[1]}\n{blocks[m[2]]}\n\n{m[3]}', page)


def contents() -> dict[Path, str]:
    """Return the text of each file that is generated, or has generated texts."""
    pages = {
        'commands.md': command_blocks(),
        'files.md': file_blocks(),
        'parameters.md': parameter_blocks(),
        'ros_interface.md': type_blocks(),
    }
    found = {PARAMETER_FILE: parameter_file()}
    for name, blocks in pages.items():
        place = REFERENCE / name
        page = place.read_text(encoding='utf-8')
        if name == 'commands.md':
            page = with_all_commands(page)
        found[place] = replaced(page, blocks, place)
    return found


def main() -> int:
    """Write the files, or check them; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--check', action='store_true', help='write nothing')
    check = parser.parse_args().check
    stale = [
        (path, text)
        for path, text in contents().items()
        if path.read_text(encoding='utf-8') != text
    ]
    for path, text in stale:
        print(
            f'{path.relative_to(ROOT)} {"is not current: make reference" if check else "written"}'
        )
        if not check:
            path.write_text(text, encoding='utf-8')
    return int(check and bool(stale))


if __name__ == '__main__':
    sys.exit(main())
