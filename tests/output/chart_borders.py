"""How far the borders of charts are off: for bakes' folders, the share of edge samples whose value is not that of their
own chart.

    chart_borders.py FOLDER ...      a line for each object, and one for each bake

A border is an edge of a triangle beyond which its chart does not go on in the layout. Samples lie along it, at most
half a texel apart; each stands for its length in texels. What a sampler reads there, bilinearly, is compared with what
it would read if the chart stood alone: a texel of which the chart holds the most keeps its value, any other one has
that of the nearest texel of which it does (of several at the same distance any one's will do). Nothing here is kiln's:
layouts are clipped against texels anew, from scene.kscene, and values come from the EXR files.
"""
import os
import sys

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import exr  # noqa: E402
from reading import run_json  # noqa: E402

SECTIONS = {"strings": 0, "meshes": 4, "objects": 5, "positions": 10, "lightmap": 14, "triangles": 16}
MESH = np.dtype([("name", "<u4"), ("flags", "<u4"), ("vertex_first", "<u8"), ("vertex_count", "<u8"),
                 ("triangle_first", "<u8"),
                 ("triangle_count", "<u8"), ("area", "<f8"), ("uv_area", "<f8")])
OBJECT = np.dtype([("name", "<u4"), ("mesh", "<u4"), ("transform", "<f8", 12), ("width", "<u4"), ("height", "<u4"),
                   ("flipped", "<u4"),
                   ("original", "<u4"), ("node", "<u4"), ("source_mesh", "<u4"), ("flags", "<u4"),
                   ("density_reason", "<u4"), ("instance", "<u4"), ("unused", "<u4")])
SAME_TEXEL = 1 / 64  # corners closer than this on the layout are one
REACH = 6            # texels within which a chart's nearest texel is looked for
LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)


class Scene:
    """The meshes, objects and layouts of a scene.kscene."""

    def __init__(self, path):
        with open(path, "rb") as file:
            data = file.read()
        header = np.frombuffer(data, "<u8", 42, 136).reshape(21, 2)

        def section(name, kind, each=1):
            first, count = (int(v) for v in header[SECTIONS[name]])
            return np.frombuffer(data, kind, count * each, first)
        self.strings = section("strings", "u1").tobytes()
        self.meshes, self.objects = section("meshes", MESH), section("objects", OBJECT)
        self.positions = section("positions", "<f4", 3).reshape(-1, 3)
        self.layout = section("lightmap", "<f4", 2).reshape(-1, 2)
        self.triangles = section("triangles", "<u4", 3).reshape(-1, 3)

    def name(self, item):
        return self.strings[item["name"]:self.strings.index(b"\0", item["name"])].decode()

    def mesh(self, number):
        """Positions, layout coordinates and corners of a mesh."""
        m = self.meshes[number]
        vertices = slice(int(m["vertex_first"]), int(m["vertex_first"] + m["vertex_count"]))
        return (self.positions[vertices], self.layout[vertices].astype(np.float64),
                self.triangles[int(m["triangle_first"]):int(m["triangle_first"] + m["triangle_count"])].astype(
                    np.int64))


def half_edges(positions, corners):
    """(triangle, corner) of every edge between two points, sorted by its two points; and for each whether the next has
    the same two."""
    _, weld = np.unique(np.ascontiguousarray(positions + 0.0).view("V12").ravel(), return_inverse=True)
    a, b = weld[corners], weld[np.roll(corners, -1, 1)]
    low, high = np.minimum(a, b).ravel(), np.maximum(a, b).ravel()
    order = np.lexsort((np.arange(len(low)), high, low))
    order = order[low[order] != high[order]]
    key = low[order] * (weld.max() + 1) + high[order]
    return order, key, weld


def find_charts(positions, texel, corners):
    """A chart's number for each triangle, and which of its three edges are borders."""
    order, key, weld = half_edges(positions, corners)
    first, second = corners.ravel()[order], np.roll(corners, -1, 1).ravel()[order]
    turned = weld[first] > weld[second]
    ends = np.where(turned[:, None], np.stack([second, first], 1), np.stack([first, second], 1))
    place = texel[ends]
    border = np.ones(corners.size, bool)
    joined = []
    for step in range(1, 8):
        same = key[step:] == key[:-step]
        near = (np.hypot(*np.moveaxis(place[step:] - place[:-step], -1, 0)) < SAME_TEXEL).all(1)
        i = np.flatnonzero(same & near)
        border[order[i]] = border[order[i + step]] = False
        joined.append(np.stack([order[i] // 3, order[i + step] // 3], 1))
        if not same.any():
            break
    joined = np.concatenate(joined)
    chart = np.arange(len(corners))
    while True:  # every triangle takes the least number among its neighbours' and its own
        before = chart.copy()
        np.minimum.at(chart, joined[:, 0], chart[joined[:, 1]])
        np.minimum.at(chart, joined[:, 1], chart[joined[:, 0]])
        chart = chart[chart]
        if np.array_equal(before, chart):
            return np.unique(chart, return_inverse=True)[1], border.reshape(-1, 3)


def clip(polygon, count, axis, bound, keep_above):
    """Polygons (n, 9, 2) of `count` corners each, cut at a line across the axis."""
    n = len(polygon)
    out, used = np.zeros_like(polygon), np.zeros(n, np.int64)
    sign = 1.0 if keep_above else -1.0
    rows = np.arange(n)
    for k in range(polygon.shape[1] - 1):
        live = k < count
        here, there = polygon[:, k], polygon[rows, np.where(k + 1 < count, k + 1, 0)]
        p, q = sign * (here[:, axis] - bound), sign * (there[:, axis] - bound)
        inside = live & (p >= 0)
        out[rows[inside], used[inside]] = here[inside]
        used += inside
        cross = live & ((p >= 0) != (q >= 0))
        t = (p[cross] / (p[cross] - q[cross]))[:, None]
        out[rows[cross], used[cross]] = here[cross] + t * (there[cross] - here[cross])
        used += cross
    return out, used


def areas_in_texels(corner, width, height, at_once=200000):
    """(triangle, texel, area) for every texel that a triangle has area in; corners (n, 3, 2) in texels."""
    low = np.clip(np.floor(corner.min(1)).astype(np.int64), 0, [width - 1, height - 1])
    high = np.clip(np.floor(corner.max(1)).astype(np.int64), 0, [width - 1, height - 1])
    size = high - low + 1
    pairs = size.prod(1)
    found = []
    ends = np.cumsum(pairs)
    first = 0
    while first < len(corner):
        last = max(first + 1, int(np.searchsorted(ends, (ends[first - 1] if first else 0) + at_once)))
        t = np.repeat(np.arange(first, last), pairs[first:last])
        k = np.arange(len(t)) - np.repeat(ends[first:last] - pairs[first:last] - (ends[first - 1] if first else 0),
                                          pairs[first:last])
        x, y = low[t, 0] + k % size[t, 0], low[t, 1] + k // size[t, 0]
        polygon = np.zeros((len(t), 9, 2))
        polygon[:, :3] = corner[t] - np.stack([x, y], 1)[:, None]
        count = np.full(len(t), 3)
        for axis in (0, 1):
            polygon, count = clip(polygon, count, axis, 0.0, True)
            polygon, count = clip(polygon, count, axis, 1.0, False)
        area = np.zeros(len(t))
        for c in range(1, 8):
            live = c + 1 < count
            a, b = polygon[:, c] - polygon[:, 0], polygon[:, c + 1 if c + 1 < 9 else 8] - polygon[:, 0]
            area += np.where(live, 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), 0.0)
        area = np.abs(area)
        keep = area > 0
        found.append((t[keep], y[keep] * width + x[keep], area[keep]))
        first = last
    return tuple(np.concatenate(f) for f in zip(*found)) if found else (np.zeros(0, np.int64),) * 3


def owners(corner, chart, width, height):
    """For each texel the chart that holds most of it, -1 for none, and whether a second one holds some."""
    triangle, texel, area = areas_in_texels(corner, width, height)
    charts = int(chart.max()) + 1 if len(chart) else 0
    pair, inverse = np.unique(texel * charts + chart[triangle], return_inverse=True)
    total = np.bincount(inverse, area, len(pair))
    order = np.lexsort((total, pair // charts))
    owner = np.full(width * height, -1, np.int64)
    owner[pair[order] // charts] = pair[order] % charts  # the last written has the most
    shared = np.bincount(pair // charts, minlength=width * height) > 1
    return owner, shared


def nearest_own(owner, values, texel, chart, width, height):
    """For each (texel, chart) what the texel may hold: the least and the greatest value among the nearest texels of
    which the chart holds the most (there may be several at the same distance); NaN where there is none within REACH."""
    offsets = sorted((dx * dx + dy * dy, dy, dx) for dx in range(-REACH, REACH + 1) for dy in range(-REACH, REACH + 1))
    low, high = np.full(len(texel), np.nan), np.full(len(texel), np.nan)
    x, y = texel % width, texel // width
    open_ = np.arange(len(texel))
    for i, (distance, dy, dx) in enumerate(offsets):
        ox, oy = x[open_] + dx, y[open_] + dy
        inside = (ox >= 0) & (oy >= 0) & (ox < width) & (oy < height)
        other = np.where(inside, oy * width + ox, 0)
        hit = inside & (owner[other] == chart[open_])
        at = open_[hit]
        low[at], high[at] = np.fmin(low[at], values[other[hit]]), np.fmax(high[at], values[other[hit]])
        if i + 1 == len(offsets) or offsets[i + 1][0] > distance:
            open_ = open_[np.isnan(low[open_])]
            if len(open_) == 0:
                break
    return low, high


def border_samples(texel, corners, chart, border):
    """Places (n, 2) in texels, the chart and the length that each stands for."""
    triangle, corner = np.nonzero(border)
    a, b = texel[corners[triangle, corner]], texel[corners[triangle, (corner + 1) % 3]]
    length = np.hypot(*(b - a).T)
    count = np.maximum(np.ceil(2 * length), 1).astype(np.int64) * (length > 0)
    edge = np.repeat(np.arange(len(count)), count)
    k = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)
    t = ((k + 0.5) / count[edge])[:, None]
    return a[edge] + t * (b[edge] - a[edge]), chart[triangle[edge]], length[edge] / count[edge]


def footprints(place, width, height):
    """The four texels (n, 4) read at places, and their weights, as a sampler that clamps at the edge does it."""
    f = place - 0.5
    base = np.floor(f).astype(np.int64)
    part = f - base
    texels, weights = [], []
    for k in range(4):
        dx, dy = k & 1, k >> 1
        x, y = np.clip(base[:, 0] + dx, 0, width - 1), np.clip(base[:, 1] + dy, 0, height - 1)
        texels.append(y * width + x)
        weights.append((part[:, 0] if dx else 1 - part[:, 0]) * (part[:, 1] if dy else 1 - part[:, 1]))
    return np.stack(texels, 1), np.stack(weights, 1)


FIELDS = ("length", "off", "half", "covered", "shared", "lone", "charts")


def measure(positions, uv, corners, values):
    """Of one object: lengths in texels of all borders; of those where the value is off by more than 10 % and by half
    and more; where a texel is read of which another chart holds the most, or which two charts hold; of borders of
    charts that hold the most of no texel nearby; and the number of charts. `values` is (height, width) of luminance."""
    height, width = values.shape
    texel = uv * [width, height]
    chart, border = find_charts(positions, texel, corners)
    owner, shared = owners(texel[corners], chart, width, height)
    place, own, length = border_samples(texel, corners, chart, border)
    read, weight = footprints(place, width, height)
    flat = values.ravel().astype(np.float64)
    got = (flat[read] * weight).sum(1)
    low, high = nearest_own(owner, flat, read.ravel(), np.repeat(own, 4), width, height)
    lone = np.isnan(low).reshape(-1, 4).any(1)
    wanted = (np.clip(flat[read], low.reshape(-1, 4), high.reshape(-1, 4)) * weight).sum(1)
    light = flat[owner >= 0].mean() if (owner >= 0).any() else 0.0
    error = np.abs(got - wanted) / np.maximum(wanted, 1e-3 * light if light > 0 else 1.0)
    counts = weight > 1e-6
    foreign = (counts & (owner[read] >= 0) & (owner[read] != own[:, None])).any(1)
    mixed = (counts & shared[read]).any(1)
    total = lambda mask: float(length[mask].sum())
    return dict(zip(FIELDS, (float(length.sum()), total(~lone & (error > 0.1)), total(~lone & (error >= 0.5)),
                             total(foreign), total(mixed),
                             total(lone), int(chart.max()) + 1 if len(chart) else 0)))


def measure_bake(folder):
    """[(name, width, height, measure)] of all objects that have a lightmap."""
    scene = Scene(os.path.join(folder, "scene.kscene"))
    files = {o["name"]: o.get("lightmap") for o in run_json(folder)["objects"]}
    found = []
    for item in scene.objects:
        name = scene.name(item)
        path = files.get(name)
        if not path or not os.path.exists(os.path.join(folder, path)):
            continue
        positions, uv, corners = scene.mesh(item["mesh"])
        values = exr.rgb(os.path.join(folder, path)).astype(np.float32) @ LUMINANCE
        found.append((name, values.shape[1], values.shape[0], measure(positions, uv, corners, values)))
    return found


def total_of(found):
    return {field: sum(m[field] for _, _, _, m in found) for field in FIELDS}


def share(m, field):
    return m[field] / m["length"] if m["length"] > 0 else 0.0


def print_row(name, size, m):
    print("%-28s %11s %7d %10.0f" % (name[:28], size, m["charts"], m["length"]) +
          "".join(" %7.2f %%" % (100 * share(m, f)) for f in ("off", "half", "covered", "shared", "lone")))


def main(folders):
    print("%-28s %11s %7s %10s" % ("", "texels", "charts", "border") +
          "".join(" %9s" % w for w in ("off 10 %", "off 50 %", "foreign", "shared", "no texel")))
    for folder in folders:
        found = measure_bake(folder)
        for name, width, height, m in found if len(found) < 60 else ():
            print_row(name, "%d x %d" % (width, height), m)
        print_row(os.path.basename(folder.rstrip("/")), "all", total_of(found))


if __name__ == "__main__":
    main(sys.argv[1:])
