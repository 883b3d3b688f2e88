"""Shared by the tests of studies: where the studies are, a scene, and recorded results."""
import importlib
import json
import os
import sys
import types

HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.normpath(os.path.join(HERE, '../..'))
STUDIES = os.path.join(ROOT, 'jobs/studies')
sys.path[:0] = [STUDIES, os.path.join(HERE, '../cli')]
os.environ.setdefault('KILN_PYTHON', sys.executable)
SCENE = os.path.join(ROOT, 'jobs/cornell.glb')

from study import sweep  # noqa: E402


def recorded(name):
    """A sweep as it was when its results were recorded (by the C program that these studies were before), and the
    record: words, kept, report, text (what it printed), files (its tables)."""
    with open(os.path.join(HERE, 'recorded', name + '.json')) as file:
        record = json.load(file)
    module = importlib.import_module(name)
    made = next(kind for kind in vars(module).values() if isinstance(kind, type) and issubclass(kind, sweep.Sweep))
    sys.argv = [name, *record['words']]
    study = made(module.__doc__)
    study.choose()
    study.report, study.kept = record['report'], types.SimpleNamespace(values=record['kept'])
    study.density = record['report']['scene']['texels_per_metre']
    study.results = [sweep.Result(record['kept']['results'].get(study.key(s))) for s in study.settings]
    study.judge()
    return study, record
