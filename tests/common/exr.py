"""OpenEXR files with numpy alone: the studies' reader and writer (jobs/studies/study/exr.py)."""
import os
import sys

sys.path.append(os.path.join(os.path.dirname(os.path.abspath(__file__)), '../../jobs/studies'))
from study.exr import *  # noqa: E402, F401, F403
