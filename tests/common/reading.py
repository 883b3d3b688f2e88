"""Files that a bake leaves behind."""
import json
import os


def run_json(folder):
    """What a bake says of itself."""
    with open(os.path.join(folder, 'run.json'), encoding='utf-8') as file:
        return json.load(file)


def content(path):
    """The bytes of a file."""
    with open(path, 'rb') as file:
        return file.read()
