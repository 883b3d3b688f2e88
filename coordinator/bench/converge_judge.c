#include <math.h>

#include "coordinator/bench/converge_private.h"

/* The longest time that all methods with views have reached. */
static double equal_time(const struct kiln_converge *c)
{
    double least = INFINITY;
    for (size_t i = 0; i < c->count; i++)
        if (c->methods[i].count > 0)
            least = fmin(least, c->methods[i].trials[c->methods[i].count - 1].seconds);
    return least;
}

/* The value at x on the line through two points. */
static double between(double x, double x0, double x1, double y0, double y1)
{
    return x1 != x0 ? y0 + (y1 - y0) * (x - x0) / (x1 - x0) : y1;
}

/* PSNR at that time; NaN if every view took longer. */
static double psnr_at(const struct kiln_converge_method *m, double seconds)
{
    size_t reached = m->count;
    while (reached > 0 && m->trials[reached - 1].seconds > seconds)
        reached--;
    if (reached == 0)
        return NAN;
    const struct kiln_converge_trial *a = &m->trials[reached - 1], *b = &m->trials[reached];
    if (reached == m->count)
        return a->picture_psnr;
    return isfinite(a->picture_psnr) && isfinite(b->picture_psnr)
               ? between(log(seconds), log(a->seconds), log(b->seconds), a->picture_psnr, b->picture_psnr)
               : a->picture_psnr;
}

/* Slope of PSNR over the binary logarithm of the time, by least squares. */
static double gain_of(const struct kiln_converge_method *m)
{
    const size_t n = m->count < KILN_CONVERGE_LAST ? m->count : KILN_CONVERGE_LAST, first = m->count - n;
    double x = 0.0, y = 0.0, xx = 0.0, xy = 0.0;
    for (size_t i = first; i < m->count; i++) {
        x += log2(m->trials[i].seconds) / (double)n;
        y += m->trials[i].picture_psnr / (double)n;
    }
    for (size_t i = first; i < m->count; i++) {
        const double off = log2(m->trials[i].seconds) - x;
        xx += off * off;
        xy += off * (m->trials[i].picture_psnr - y);
    }
    return xx > 0.0 && isfinite(xy) ? xy / xx : NAN;
}

static double time_to_level(const struct kiln_converge_method *m, bool *at_most)
{
    size_t i = 0;
    while (i < m->count && m->trials[i].picture_psnr < KILN_CONVERGE_LEVEL)
        i++;
    *at_most = i == 0 && m->count > 0;
    if (i == m->count)
        return NAN;
    const struct kiln_converge_trial *b = &m->trials[i], *a = i > 0 ? b - 1 : b;
    return i > 0 && isfinite(b->picture_psnr)
               ? exp(between(KILN_CONVERGE_LEVEL, a->picture_psnr, b->picture_psnr, log(a->seconds), log(b->seconds)))
               : b->seconds;
}

void kiln_converge_judge(struct kiln_converge *c)
{
    c->equal_seconds = equal_time(c);
    for (size_t i = 0; i < c->count; i++) {
        struct kiln_converge_method *m = &c->methods[i];
        m->psnr_at_equal_time = psnr_at(m, c->equal_seconds);
        m->gain = gain_of(m);
        m->seconds_to_level = time_to_level(m, &m->at_most);
    }
}
