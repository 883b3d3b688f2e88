#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/bench/tradeoff_private.h"

static bool beats(const struct kiln_setting_result *a, const struct kiln_setting_result *b)
{
    return a->done && a->seconds <= b->seconds && a->error[0] <= b->error[0] &&
           (a->seconds < b->seconds || a->error[0] < b->error[0]);
}

void kiln_front_mark(struct kiln_sweep *sweep)
{
    for (size_t i = 0; i < sweep->count; i++) {
        struct kiln_setting_result *one = &sweep->results[i];
        one->front = one->done;
        for (size_t j = 0; j < sweep->count; j++)
            one->front = one->front && !beats(&sweep->results[j], one);
    }
}

/* Sorts bakes by time. */
static void sort(const struct kiln_sweep *sweep, size_t *indices, size_t count)
{
    for (size_t i = 1; i < count; i++)
        for (size_t j = i; j > 0 && sweep->results[indices[j]].seconds < sweep->results[indices[j - 1]].seconds; j--) {
            const size_t index = indices[j];
            indices[j] = indices[j - 1];
            indices[j - 1] = index;
        }
}

size_t kiln_front_list(const struct kiln_sweep *sweep, size_t *indices)
{
    size_t count = 0;
    for (size_t i = 0; i < sweep->count; i++)
        if (sweep->results[i].front)
            indices[count++] = i;
    sort(sweep, indices, count);
    return count;
}

/* The front of the bakes that are no presets. */
static size_t list_others(const struct kiln_sweep *sweep, size_t *indices)
{
    size_t count = 0;
    for (size_t i = 0; i < sweep->count; i++) {
        bool front = sweep->results[i].done && !sweep->settings[i].preset;
        for (size_t j = 0; j < sweep->count; j++)
            front = front && (sweep->settings[j].preset || !beats(&sweep->results[j], &sweep->results[i]));
        if (front)
            indices[count++] = i;
    }
    sort(sweep, indices, count);
    return count;
}

double kiln_front_seconds(const struct kiln_sweep *sweep, double error)
{
    size_t indices[KILN_SETTINGS_MOST];
    const size_t count = list_others(sweep, indices);
    for (size_t i = 1; i < count; i++) {
        const struct kiln_setting_result *a = &sweep->results[indices[i - 1]], *b = &sweep->results[indices[i]];
        if (a->error[0] < error || b->error[0] > error || !(b->error[0] > 0.0))
            continue;
        const double over = log(a->error[0] / b->error[0]), part = over > 0.0 ? log(a->error[0] / error) / over : 0.0;
        return a->seconds * pow(b->seconds / a->seconds, part);
    }
    return (double)NAN;
}
