#include "worker/backend/guide.h"

#include <math.h>
#include <string.h>

#define DEFENSIVE 0.3 /* share of the cosine in the density */
enum { MOST = KILN_GUIDE_SIDE, EDGES = KILN_GUIDE_EDGES, SMOOTHED = 2 };

/* Smooths the cells once over neighbours: v is periodic, u is not. */
static void smooth(double cells[MOST][MOST], uint32_t side)
{
    double before[MOST][MOST];
    memcpy(before, cells, sizeof before);
    for (uint32_t i = 0; i < side; i++)
        for (uint32_t j = 0; j < side; j++) {
            const uint32_t low = i > 0 ? i - 1 : 0, high = i + 1 < side ? i + 1 : i;
            cells[i][j] = (4.0 * before[i][j] + before[low][j] + before[high][j] + before[i][(j + side - 1) % side] +
                           before[i][(j + 1) % side]) /
                          8.0;
        }
}

/* Cumulative sums of positive values, divided by their total. */
static void accumulate(const double values[MOST], float *cumulative)
{
    double all = 0.0, sum = 0.0;
    for (uint32_t i = 0; i < MOST; i++)
        all += values[i];
    for (uint32_t i = 0; i < MOST; i++) {
        cumulative[i] = (float)(sum / all);
        sum += values[i];
    }
    cumulative[MOST] = 1.0f;
}

/* Makes a guide from a density. Weights are computed from the rounded cumulative sums, so that the mean is exact. */
static void make(float *guide, double density[MOST][MOST])
{
    double rows[MOST] = {0};
    for (uint32_t i = 0; i < MOST; i++) {
        for (uint32_t j = 0; j < MOST; j++)
            rows[i] += density[i][j];
        accumulate(density[i], &guide[(i + 1) * EDGES]);
    }
    accumulate(rows, guide);
    for (uint32_t i = 0; i < MOST; i++)
        for (uint32_t j = 0; j < MOST; j++) {
            const float *row = &guide[i], *column = &guide[(i + 1) * EDGES + j];
            guide[KILN_GUIDE_WEIGHTS + i * MOST + j] =
                1.0f / ((float)(MOST * MOST) * (row[1] - row[0]) * (column[1] - column[0]));
        }
}

bool kiln_guide_make(float *guide, const float *learnt, uint32_t side)
{
    double cells[MOST][MOST] = {{0}}, sum = 0.0, squares = 0.0;
    const double count = (double)side * side;
    for (uint32_t k = 0; k < side * side; k++)
        cells[k / side][k % side] = (double)learnt[k] * (double)learnt[k];
    for (int round = 0; round < SMOOTHED; round++)
        smooth(cells, side);
    for (uint32_t i = 0; i < side; i++)
        for (uint32_t j = 0; j < side; j++) {
            squares += cells[i][j];
            cells[i][j] = sqrt(cells[i][j]);
            sum += cells[i][j];
        }
    if (!(sum > 0.0) || !(count * squares >= KILN_GUIDE_LEAST * sum * sum))
        return false;
    double density[MOST][MOST];
    for (uint32_t i = 0; i < MOST; i++)
        for (uint32_t j = 0; j < MOST; j++)
            density[i][j] = DEFENSIVE + (1.0 - DEFENSIVE) * cells[i * side / MOST][j * side / MOST] * count / sum;
    make(guide, density);
    return true;
}
