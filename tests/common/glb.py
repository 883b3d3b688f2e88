"""Small .glb scenes: the writer of the studies (jobs/studies/study/glb.py)."""
import os
import sys

sys.path.append(os.path.join(os.path.dirname(os.path.abspath(__file__)), '../../jobs/studies'))
from study.glb import *  # noqa: E402, F401, F403
