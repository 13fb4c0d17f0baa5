"""Entry points of scripts that an earlier `make dev` installed; `make dev` makes new ones."""

from importlib import import_module

from resting_aspects_ros.cli import main as resting_aspects

__all__ = ['resting_aspects']


def __getattr__(name: str) -> object:
    if name.startswith('_'):
        raise AttributeError(name)
    return import_module(f'resting_aspects_ros.nodes.{name}').main
