"""Print the path of this Python if set-up can use it, and else what is missing.

Called by tools/find_python; runs on any Python 3.
"""

import importlib.util
import os
import shutil
import sys
import sysconfig
from pathlib import Path

version = '.'.join(map(str, sys.version_info[:2]))
if version not in ('3.10', '3.11', '3.12'):
    sys.exit('is Python ' + version)

missing = {}  # what is not found, by the Debian package that it is in
if not Path(sysconfig.get_path('include'), 'Python.h').exists():
    missing['python' + version + '-dev'] = 'Python.h'
if not (importlib.util.find_spec('venv') and importlib.util.find_spec('ensurepip')):
    missing['python' + version + '-venv'] = 'the modules venv and ensurepip'
compilers = os.environ.get('CXX', '').split()[:1] or ['c++', 'g++', 'clang++']
if not any(map(shutil.which, compilers)):
    missing['g++'] = 'a C++ compiler'
if missing:
    packages = ' '.join(missing)
    sys.exit(' and '.join(missing.values()) + ' not found: sudo apt install ' + packages)
print(os.path.realpath(sys.executable))
