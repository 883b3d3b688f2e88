#include "worker/backend/embree/guide.h"

#include <math.h>
#include <string.h>

#define DEFENSIVE 0.3 /* share of the cosine in the density */
enum { MOST = KILN_GUIDE_SIDE_MOST, SMOOTHED = 2 };

/* One round over neighbours: v is a circle, u ends. */
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

/* The cumulative shares of `count` positive values. */
static void accumulate(const double *values, uint32_t count, float *cumulative)
{
    double all = 0.0, sum = 0.0;
    for (uint32_t i = 0; i < count; i++)
        all += values[i];
    for (uint32_t i = 0; i < count; i++) {
        cumulative[i] = (float)(sum / all);
        sum += values[i];
    }
    cumulative[count] = 1.0f;
}

/* The weights are those of the cumulative shares as rounded: so that the mean is right. */
static void make(struct guide *g, double density[MOST][MOST], uint32_t side)
{
    double rows[MOST] = {0};
    g->side = side;
    for (uint32_t i = 0; i < side; i++) {
        for (uint32_t j = 0; j < side; j++)
            rows[i] += density[i][j];
        accumulate(density[i], side, g->columns[i]);
    }
    accumulate(rows, side, g->rows);
    for (uint32_t i = 0; i < side; i++)
        for (uint32_t j = 0; j < side; j++)
            g->weight[i][j] = 1.0f / ((float)(side * side) * (g->rows[i + 1] - g->rows[i]) *
                                      (g->columns[i][j + 1] - g->columns[i][j]));
}

bool guide_make(struct guide *g, const float *learnt, uint32_t side)
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
    for (uint32_t i = 0; i < side; i++)
        for (uint32_t j = 0; j < side; j++)
            cells[i][j] = DEFENSIVE + (1.0 - DEFENSIVE) * cells[i][j] * count / sum;
    make(g, cells, side);
    return true;
}
