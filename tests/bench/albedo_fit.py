"""Makes shaders/shared/microfacet_fit.h: how much light rough interfaces send on after one scattering, as polynomials.

    /usr/bin/python3 tests/bench/albedo_fit.py > shaders/shared/microfacet_fit.h

Numbers are means over 10,946 points of a lattice, warped to visible facets; the fits make the largest error small. The
errors, on standard error, are those over cosines from 0.015, roughnesses alpha 0.001 to 1 and indices 1.05 to 3; nearer
to the horizon three times as much is allowed (of the coat five times, from 0.04). Fits lie on the side where a white
furnace is a little too dark.
"""
import sys

import numpy as np

COUNT, STEP = 10946, 6765
V = (np.arange(COUNT) + 0.5) / COUNT
TURN = 2 * np.pi * (np.arange(COUNT) * STEP % COUNT) / COUNT
COSINES = np.concatenate([[0.0025, 0.005, 0.01, 0.02, 0.03], np.linspace(0.045, 1, 28)])
ALPHAS = np.concatenate([[0.001, 0.003, 0.01, 0.02], np.linspace(0.2, 1, 14) ** 2])
INDICES = np.array([1.05, 1.07, 1.1, 1.15, 1.2, 1.26, 1.33, 1.41, 1.5, 1.65, 1.8, 2.0, 2.2, 2.5, 2.75, 3.0])
COAT_INDEX = 1.5
COAT_ALPHAS = np.array([0.0001, 0.01, 0.05, 0.16, 0.36, 0.64, 1.0])
BASE_ALPHAS = np.array([0.001, 0.003, 0.01, 0.025, 0.05, 0.09, 0.16, 0.25, 0.36, 0.5, 0.65, 0.81, 1.0])
CELLS = 200
GRID = np.linspace(0, 1, CELLS + 1) ** 2
IMPORTANT = np.where(COSINES < 0.015, 1 / 3, 1)
TOO_BRIGHT = 0.0005  # what a furnace may be above 1


def smith(z, alpha):
    """Lambda of Smith's masking."""
    z = np.maximum(np.abs(z), 1e-9)
    return 0.5 * (np.sqrt(1 + alpha ** 2 * np.maximum(1 / (z * z) - 1, 0)) - 1)


def visible(cosine, alpha):
    """A direction at this cosine, and the facets that it sees."""
    o = np.array([np.sqrt(1 - cosine * cosine), 0, cosine])
    s = np.array([o[0] * alpha, 0, o[2]])
    s /= np.linalg.norm(s)
    z = (1 - V) * (1 + s[2]) - s[2]
    r = np.sqrt(np.maximum(0, 1 - z * z))
    h = np.stack([alpha * (r * np.cos(TURN) + s[0]), alpha * r * np.sin(TURN), z + s[2]])
    return o, h / np.linalg.norm(h, axis=0)


def fresnel(cosine, index):
    """Reflectance of a dielectric."""
    through = np.sqrt(np.maximum(0, 1 - (1 - cosine ** 2) / index ** 2))
    s = (cosine - index * through) / (cosine + index * through + 1e-30)
    p = (index * cosine - through) / (index * cosine + through + 1e-30)
    return np.where(through > 0, 0.5 * (s * s + p * p), 1)


def reflected(cosine, alpha):
    """Cosines to the facets, cosines of what they reflect, and its weights."""
    o, h = visible(cosine, alpha)
    c = np.abs(o @ h)
    z = 2 * c * h[2] - o[2]
    weight = (1 + smith(cosine, alpha)) / (1 + smith(cosine, alpha) + smith(z, alpha)) * (z > 0)
    return c, z, weight


def transmitted(cosine, alpha, index):
    """Mean of what goes through."""
    o, h = visible(cosine, alpha)
    c = np.abs(o @ h)
    squared = 1 - (1 - c * c) / (index * index)
    z = -o[2] / index + (c / index - np.sqrt(np.maximum(squared, 0))) * h[2]
    weight = (1 + smith(cosine, alpha)) / (1 + smith(cosine, alpha) + smith(z, alpha))
    return ((1 - fresnel(c, index)) * (squared > 0) * (z < 0) * weight).mean()


def tabulate():
    """Means of what is reflected were all reflected, of what an index reflects, and of what is lost on both sides."""
    whole = np.zeros((len(COSINES), len(ALPHAS)))
    part, lost, lost_dense = (np.zeros(whole.shape + (len(INDICES),)) for _ in range(3))
    for i, cosine in enumerate(COSINES):
        for j, alpha in enumerate(ALPHAS):
            c, _, weight = reflected(cosine, alpha)
            whole[i, j] = weight.mean()
            for k, index in enumerate(INDICES):
                part[i, j, k] = (fresnel(c, index) * weight).mean()
                lost[i, j, k] = 1 - part[i, j, k] - transmitted(cosine, alpha, index)
                lost_dense[i, j, k] = 1 - (fresnel(c, 1 / index) * weight).mean() - \
                    transmitted(cosine, alpha, 1 / index)
    return whole, part, lost, lost_dense


def tensor(*axes):
    """Columns of products of Chebyshev polynomials; an axis is (values in 0 to 1, number of polynomials)."""
    columns = None
    for values, degree in axes:
        one = np.polynomial.chebyshev.chebvander(2 * values.ravel() - 1, degree - 1)
        columns = one if columns is None else (columns[:, :, None] * one[:, None, :]).reshape(len(one), -1)
    return columns


def solve(columns, wanted, error_of, start, rounds=12):
    """Coefficients whose largest error is small: least squares, with weights that grow where errors are large."""
    weights, best, found = start.copy(), 9.0, None
    for _ in range(rounds):
        normal = (columns * weights[:, None]).T @ columns
        normal += 1e-11 * np.trace(normal) / len(normal) * np.eye(len(normal))
        coefficients = np.linalg.solve(normal, (columns * weights[:, None]).T @ wanted)
        errors = np.abs(error_of(columns @ coefficients))
        if errors.max() < best:
            best, found = errors.max(), coefficients
        weights *= errors + 1e-9
        weights /= weights.mean()
    return best, found


def solve_lost(columns, wanted):
    """Coefficients of what is lost, shifted so that it is hardly ever too much."""
    importance = np.repeat(IMPORTANT, len(wanted) // len(COSINES))
    error, found = solve(columns, wanted, lambda values: (values - wanted) * importance, importance.copy())
    found[0] -= max(0, error - TOO_BRIGHT)
    return error, found


def powers(coefficients, shape):
    """Coefficients of powers, from those of Chebyshev polynomials, along each axis."""
    result = coefficients.reshape(shape)
    for axis, count in enumerate(shape):
        change = np.stack([np.pad(np.polynomial.chebyshev.cheb2poly(row), (0, count))[:count]
                           for row in np.eye(count)])
        result = np.moveaxis(np.tensordot(result, change, (axis, 0)), -1, axis)
    return result.ravel()


def print_table(name, text, coefficients, shape):
    """One array of the header."""
    numbers = powers(coefficients, shape)
    print(f'/* {text} */')
    print(f'KILN_CONSTANT float {name}[{len(numbers)}] = {{')
    line = '   '
    for number in numbers:
        word = f' {number:.8e}f,'
        if len(line) + len(word) > 120:
            print(line)
            line = '   '
        line += word
    print(line.rstrip(',') + '};')


def report(name, error):
    print(f'{name}: {error:.4f}', file=sys.stderr)


def near(cosine, alpha):
    return np.sqrt(cosine / (cosine + 2 * alpha))


def solve_cosine(base, exact, scale, reflectance, columns, shift, important):
    """The effective cosine, base + scale * polynomial, from the reflectance at it."""
    wanted = ((exact - base) / scale).ravel()
    slope = (reflectance(np.clip(exact + 0.005, 0, 1)) - reflectance(np.clip(exact - 0.005, 0, 1))) / 0.01
    start = (np.abs(slope) * scale).ravel() ** 2
    goal = reflectance(exact) + shift
    importance = np.repeat(important, exact[0].size)

    def error_of(values):
        return (reflectance(np.clip(base + scale * values.reshape(base.shape), 0, 1)) - goal).ravel() * importance
    return solve(columns, wanted, error_of, start / start.mean())


def fit_whole(whole):
    m, a = np.meshgrid(COSINES, ALPHAS, indexing='ij')
    error, c = solve_lost(tensor((near(m, a), 9), (np.sqrt(a), 8)), (1 - whole).ravel())
    report('whole', error)
    print_table('KILN_FIT_WHOLE', '1 - albedo where all is reflected, 9 x 8: near, root of alpha', c, (9, 8))


def lost_across(cosine, turn, alpha_x, alpha_y):
    """What brushed facets lose of light from a direction, were all reflected."""
    sine = np.sqrt(1 - cosine * cosine)
    o = np.array([sine * np.cos(turn), sine * np.sin(turn), cosine])
    s = o * [alpha_x, alpha_y, 1]
    s /= np.linalg.norm(s)
    z = (1 - V) * (1 + s[2]) - s[2]
    r = np.sqrt(np.maximum(0, 1 - z * z))
    h = np.stack([alpha_x * (r * np.cos(TURN) + s[0]), alpha_y * (r * np.sin(TURN) + s[1]), z + s[2]])
    h /= np.linalg.norm(h, axis=0)
    i = 2 * (o @ h) * h - o[:, None]
    stretch = np.sqrt((alpha_x * i[0]) ** 2 + (alpha_y * i[1]) ** 2 + i[2] ** 2) / np.maximum(i[2], 1e-9)
    own = np.sqrt((alpha_x * o[0]) ** 2 + (alpha_y * o[1]) ** 2 + cosine ** 2) / cosine
    return 1 - ((1 + own) / (own + stretch) * (i[2] > 0)).mean()


def fit_across():
    """As `whole`, for two roughnesses: along a direction's own plane facets have the roughness `along`."""
    m, wide, ratio, turn = np.meshgrid(
        np.concatenate([[0.01, 0.035], np.linspace(0.05, 0.35, 5), np.linspace(0.45, 1, 5)]),
        np.array([0.05, 0.16, 0.28, 0.4, 0.52, 0.64, 0.76, 0.88, 1]) ** 2,
        np.array([1, 0.8, 0.6, 0.45, 0.3, 0.2, 0.12, 0.06, 0.02, 0.001]), np.linspace(0, np.pi / 2, 6), indexing='ij')
    narrow = np.maximum(wide * ratio, 1e-3)
    wanted = np.vectorize(lost_across)(m, turn, wide, narrow).ravel()
    along = np.sqrt((wide * np.cos(turn)) ** 2 + (narrow * np.sin(turn)) ** 2)
    importance = np.where(m < 0.04, 1 / 3, 1).ravel()
    columns = tensor((near(m, along), 8), (np.sqrt(wide), 5), (np.sqrt(narrow / wide), 4), (along / wide, 4))
    error, c = solve(columns, wanted, lambda values: (values - wanted) * importance, importance.copy(), 5)
    c[0] -= max(0, error - TOO_BRIGHT - 0.0021)  # errors are largest where little light comes from
    report('across', error)
    print_table('KILN_FIT_ACROSS', 'as WHOLE, of two roughnesses, 8 x 5 x 4 x 4: near, root of the larger, root of the '
                'ratio, along over the larger', c, (8, 5, 4, 4))


def fit_effective(whole, part):
    m, a, n = np.meshgrid(COSINES, ALPHAS, INDICES, indexing='ij')
    table = np.linspace(0, 1, 8001)
    exact = np.zeros(m.shape)
    for k, index in enumerate(INDICES):
        exact[:, :, k] = np.interp(-part[:, :, k] / whole, -fresnel(table, index), table)
    r = np.sqrt(a)
    columns = tensor((near(m, a), 5), (r, 4), (np.sqrt(1.5 * (1 - 1 / n)), 3))
    error, c = solve_cosine(m, exact, r, lambda cosine: whole[:, :, None] * fresnel(cosine, n), columns, 0.0015,
                            IMPORTANT)
    report('effective', error)
    print_table('KILN_FIT_EFFECTIVE', 'effective cosine for Fresnel, 5 x 4 x 3: near, root of alpha, index', c,
                (5, 4, 3))


def fit_lost(lost, lost_dense):
    m, a, n = np.meshgrid(COSINES, ALPHAS, INDICES, indexing='ij')
    q, r, z = near(m, a), np.sqrt(a), np.sqrt(1.5 * (1 - 1 / n))
    error, c = solve_lost(tensor((q, 8), (r, 6), (z, 4)), lost.ravel())
    report('lost', error)
    print_table('KILN_FIT_LOST', 'lost from the side of the lower index, 8 x 6 x 4: near, root of alpha, index', c,
                (8, 6, 4))
    x = m - np.sqrt(1 - 1 / (n * n))
    beyond = 0.5 + 0.5 * x / np.sqrt(x * x + 0.25 * a * a + 1e-6)
    columns = np.concatenate([tensor((q, 8), (r, 6), (z, 4)), tensor((q, 8), (r, 6), (z, 4)) *
                              beyond.ravel()[:, None]], 1)
    error, c = solve_lost(columns, lost_dense.ravel())
    report('lost, dense', error)
    print_table('KILN_FIT_DENSE', 'lost from the other side, 8 x 6 x 4,', c[:192], (8, 6, 4))
    print_table('KILN_FIT_BEYOND', 'and what beyond the critical angle is not, 8 x 6 x 4', c[192:], (8, 6, 4))


def scatter_matrix(alpha):
    """Energy from cosine to cosine in a white metal, all scatterings, between the places of GRID."""
    rows = []
    for cosine in np.maximum(GRID, 0.002):
        _, z, weight = reflected(cosine, alpha)
        z = np.clip(z, 0, 1)
        i = np.minimum((np.sqrt(z) * CELLS).astype(int), CELLS - 1)
        x = (z - GRID[i]) / (GRID[i + 1] - GRID[i])
        size = CELLS + 1
        rows.append((np.bincount(i, weight * (1 - x), size) + np.bincount(i + 1, weight * x, size)) / COUNT)
    matrix = np.array(rows)
    lost = 1 - matrix.sum(1)
    share = lost * GRID * np.gradient(GRID)
    share /= share.sum()
    return matrix + np.outer(lost, share)


def coat_cosines():
    """What a coat lets through twice is (1 - E)(1 - E) / sqrt(B B): B is 1 - E at this cosine, so that all light comes
    out of a white metal under it (Sinkhorn's balancing)."""
    result = np.zeros((len(COSINES), len(BASE_ALPHAS), len(COAT_ALPHAS)))
    coats = []
    for alpha in COAT_ALPHAS:
        triples = [reflected(max(cosine, 0.002), alpha) for cosine in GRID]
        coats.append(np.array([(fresnel(c, COAT_INDEX) * weight).mean() for c, _, weight in triples]))
    for j, base in enumerate(BASE_ALPHAS):
        matrix = scatter_matrix(base)
        for k, coat in enumerate(coats):
            h = np.sqrt(1 - coat)
            for _ in range(400):
                h = np.sqrt(h * (1 - coat) / (matrix @ h))
            result[:, j, k] = np.interp(COSINES, GRID, np.interp(-(1 - ((1 - coat) / h) ** 2), -coat, GRID))
    return result, coats


def fit_coat():
    exact, coats = coat_cosines()
    m, a, _ = np.meshgrid(COSINES, BASE_ALPHAS, COAT_ALPHAS, indexing='ij')
    coat_root = np.sqrt(np.broadcast_to(COAT_ALPHAS, m.shape))
    scale = a / np.sqrt(m + a)

    def reflectance(cosine):
        through = [np.interp(COSINES, GRID, 1 - coat) for coat in coats]
        return np.stack([through[k][:, None] / np.sqrt(1 - np.interp(cosine[:, :, k], GRID, coat))
                         for k, coat in enumerate(coats)], 2)
    columns = tensor((near(m, a), 9), (np.sqrt(a), 8), (coat_root, 5))
    error, c = solve_cosine(m, exact, scale, reflectance, columns, -0.0015,
                            np.where(COSINES < 0.04, 0.2, 1))
    report('coat, factor', error)
    print_table('KILN_FIT_COAT', 'effective cosine for light that leaves a coat, 9 x 8 x 5: near, roots of both alphas',
                c, (9, 8, 5))


def main():
    whole, part, lost, lost_dense = tabulate()
    print('/* Coefficients for shaders/shared/microfacet_albedo.h, which says what they mean; made by\n'
          ' * tests/bench/albedo_fit.py. Powers of 2 x - 1, of each variable x; the last variable is the fastest. */')
    print('#ifndef KILN_SHADERS_SHARED_MICROFACET_FIT_H\n#define KILN_SHADERS_SHARED_MICROFACET_FIT_H\n')
    print('#include "shaders/shared/language.h"\n')
    print('/* clang-format off */')
    fit_whole(whole)
    fit_across()
    fit_effective(whole, part)
    fit_lost(lost, lost_dense)
    fit_coat()
    print('/* clang-format on */\n\n#endif')


if __name__ == '__main__':
    main()
