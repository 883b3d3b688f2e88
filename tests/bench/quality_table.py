"""The rows of quality.csv, and the table that README.md has of them. quality.py writes the rows."""
import csv
import os

COLUMNS = ('version', 'machine', 'scene', 'light', 'preset', 'texels', 'points', 'texels_per_metre', 'seed', 'asked',
           'true', 'stated', 'rounds', 'seconds', 'processor_seconds', 'reference', 'reference_noise')
KEY = ('version', 'machine', 'scene', 'preset', 'texels', 'seed', 'reference')
TITLES = {'draft': 'draft: 20 %', 'preview': 'preview: 5 %', 'production': 'production: 2 %',
          'reference': 'reference: 1 %'}
MISSED, NOISY = 1.05, 0.5  # of what was asked for
BEGIN, END = '<!-- tests/bench/quality.py -->', '<!-- end -->'


def read(path):
    """Rows as dictionaries of texts, in the file's order; none where there is no file."""
    if not os.path.exists(path):
        return []
    with open(path, newline='') as file:
        rows = list(csv.DictReader(file))
    if rows and tuple(rows[0]) != COLUMNS:
        raise ValueError('%s has other columns than quality.py writes: name another file' % path)
    return rows


def add(path, row):
    """Writes a row, and first the columns' names where the file is new."""
    new = not os.path.exists(path)
    with open(path, 'a', newline='') as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator='\n')
        if new:
            writer.writeheader()
        writer.writerow(row)


def key(row):
    return tuple(str(row[name]) for name in KEY)


def seconds(value):
    return '%.1f s' % value if value < 10 else '%.0f s' % value if value < 120 else '%.0f min' % (value / 60)


def rounded(texels):
    """A number of texels in words, a power of two as one."""
    power = int(texels).bit_length() - 1
    return 'about %s' % ('2^%d' % power if int(texels) == 1 << power else texels)


def cell(rows):
    """True error in percent, least to most of the seeds, and the mean time, by the clock and of the processors. Bold: a
    seed missed what was asked for. At most: the truth is too noisy to tell."""
    true, asked = [100 * float(r['true']) for r in rows], 100 * float(rows[0]['asked'])
    least, most = '%.1f' % min(true), '%.1f' % max(true)
    error = '%s %%' % most if least == most else '%s to %s %%' % (least, most)
    if max(100 * float(r['reference_noise']) for r in rows) > NOISY * asked:
        error = 'at most %s %%' % most
    elif max(true) > MISSED * asked:
        error = '**%s**' % error
    return '%s, %s (%s)' % (error, *(seconds(sum(float(r[c]) for r in rows) / len(rows))
                                     for c in ('seconds', 'processor_seconds')))


def newest(rows):
    """Rows of the version that comes last in the file, for each machine, density, scene and preset; the last one of a
    seed."""
    found = {}
    for row in rows:
        place = tuple(row[name] for name in ('machine', 'texels', 'scene', 'preset'))
        if row['version'] != found.setdefault(place, (row['version'], {}))[0]:
            found[place] = (row['version'], {})
        found[place][1][row['seed']] = row
    return {place: list(seeds.values()) for place, (_, seeds) in found.items()}


def table(rows):
    """Markdown: a table for each machine and density."""
    cells, lines = newest(rows), []
    for machine, texels in dict.fromkeys(place[:2] for place in cells):
        here = {place[2:]: found for place, found in cells.items() if place[:2] == (machine, texels)}
        presets = [p for p in (*TITLES, *dict.fromkeys(place[1] for place in here if place[1] not in TITLES))
                   if any(place[1] == p for place in here)]
        seeds = sorted({len(found) for found in here.values()})
        lines += ['', '%s, %s, %s seed%s:' % (
            machine, "the presets' densities" if texels == 'preset' else '%s texels a scene' % rounded(texels),
            ' to '.join(dict.fromkeys((str(seeds[0]), str(seeds[-1])))), '' if seeds[-1] == 1 else 's'), '',
            '| scene, light | %s | noise |' % ' | '.join(TITLES.get(p, p) for p in presets),
            '| --- |' + ' --- |' * (len(presets) + 1)]
        for scene in dict.fromkeys(place[0] for place in here):
            of_scene = [found for place, found in here.items() if place[0] == scene]
            lines.append('| %s, %s | %s | %.1f %% |' % (
                scene, of_scene[0][0]['light'],
                ' | '.join(cell(here[scene, p]) if (scene, p) in here else '' for p in presets),
                100 * max(float(r['reference_noise']) for found in of_scene for r in found)))
    return '\n'.join(lines[1:]) + '\n' if lines else ''


def put(readme, rows):
    """Puts the table between the two marks of a page."""
    with open(readme) as file:
        text = file.read()
    before, rest = text.split(BEGIN, 1)
    after = rest.split(END, 1)[1]
    with open(readme, 'w') as file:
        file.write(before + BEGIN + '\n' + table(rows) + END + after)
