#include "coordinator/run/time_left.h"

#include <math.h>
#include <string.h>

#define EXACT 0.1          /* fraction of all expectations that counts as exact when stages to come are corrected */
#define NEARLY 0.99        /* largest share of the whole while the last stage is under way */
#define EARLY 0.1          /* largest share of the whole while a stage whose expectation is rough has not told more */
#define LATE 0.3           /* of the time of a stage that takes longer than expected: what is left at least */
#define BELIEVED_HALF 0.05 /* share of a stage done at which its own word counts as much as the expectation */

/* ---- stages ---- */

static bool is_under_way(const struct kiln_time_left *t) { return t->present < t->count; }

void kiln_time_left_begin(struct kiln_time_left *t, double now)
{
    *t = (struct kiln_time_left){
        .begin = now, .since = now, .updated = now, .share = -1.0, .left = -1.0, .whole_left = -1.0};
}

static size_t find(const struct kiln_stage *stages, size_t count, const char *name)
{
    size_t i = 0;
    while (i < count && strcmp(stages[i].name, name) != 0)
        i++;
    return i;
}

void kiln_time_left_expect(struct kiln_time_left *t, const struct kiln_stage *stages, size_t count, double now)
{
    const struct kiln_time_left before = *t;
    t->count = count < KILN_STAGES_MAX ? count : KILN_STAGES_MAX;
    t->present = t->count;
    for (size_t i = 0; i < t->count; i++) {
        const size_t old = find(before.stages, before.count, stages[i].name);
        t->stages[i] = stages[i];
        t->over[i] = old < before.count && before.over[old];
        if (is_under_way(&before) && old == before.present)
            t->present = i;
    }
    if (!is_under_way(t))
        t->since = now;
}

/* The stage under way is over. */
static void end_stage(struct kiln_time_left *t, double now)
{
    if (!is_under_way(t))
        return;
    t->over[t->present] = true;
    if (!t->stages[t->present].rough && t->stages[t->present].seconds >= 0.0) {
        t->expected += t->stages[t->present].seconds;
        t->taken += now - t->since;
    }
    t->present = t->count;
}

void kiln_time_left_phase(struct kiln_time_left *t, const char *name, double now)
{
    const size_t next = find(t->stages, t->count, name);
    if (next == t->count || t->over[next] || next == t->present)
        return;
    end_stage(t, now);
    for (size_t i = 0; i < next; i++)
        t->over[i] = true;
    t->present = next;
    t->since = now;
    t->share = t->left = -1.0;
}

void kiln_time_left_tell(struct kiln_time_left *t, double share, double left, double now)
{
    t->share = share;
    t->left = left;
    t->told = now;
}

void kiln_time_left_end(struct kiln_time_left *t, double now)
{
    end_stage(t, now);
    for (size_t i = 0; i < t->count; i++)
        t->over[i] = true;
    t->whole_left = t->count > 0 ? 0.0 : -1.0;
    t->whole_share = t->count > 0 ? 1.0 : t->whole_share;
}

/* ---- what is left ---- */

/* Factor on what stages to come are expected to take. */
static double correction(const struct kiln_time_left *t)
{
    double all = 0.0;
    for (size_t i = 0; i < t->count; i++)
        all += t->stages[i].rough ? 0.0 : fmax(t->stages[i].seconds, 0.0);
    const double exact = EXACT * all, factor = exact > 0.0 ? (t->taken + exact) / (t->expected + exact) : 1.0;
    return fmin(fmax(factor, 1.0 / KILN_TIME_LEFT_FACTOR), KILN_TIME_LEFT_FACTOR);
}

/* Whether a stage that is not over has an unknown expectation, and has not told either. */
static bool is_unknown(const struct kiln_time_left *t)
{
    for (size_t i = 0; i < t->count; i++)
        if (!t->over[i] && t->stages[i].seconds < 0.0 && (i != t->present || t->left < 0.0))
            return true;
    return false;
}

/* Seconds left of the stage under way. */
static double left_of_stage(const struct kiln_time_left *t, double factor, double now)
{
    const double expected = factor * t->stages[t->present].seconds, spent = fmax(now - t->since, 0.0);
    if (t->share < 0.0)
        return fmax(expected > 0.0 ? expected * exp(-spent / expected) : 0.0, spent >= expected ? LATE * spent : 0.0);
    const double by_expectation = expected * (1.0 - t->share);
    if (t->left < 0.0)
        return by_expectation;
    const double by_word = fmax(t->left - (now - t->told), 0.0),
                 trust = expected < 0.0 ? 1.0 : t->share / (t->share + BELIEVED_HALF);
    return trust * by_word + (1.0 - trust) * by_expectation;
}

/* Seconds left of the whole. */
static double left_of_whole(const struct kiln_time_left *t, double now)
{
    const double factor = correction(t);
    double left = is_under_way(t) ? left_of_stage(t, factor, now) : 0.0;
    for (size_t i = 0; i < t->count; i++)
        if (i != t->present && !t->over[i])
            left += factor * t->stages[i].seconds;
    return left;
}

/* Whether a stage whose expectation is rough is still to come, or has told too little. */
static bool is_rough(const struct kiln_time_left *t)
{
    for (size_t i = 0; i < t->count; i++)
        if (t->stages[i].rough && !t->over[i] && (i != t->present || t->share < BELIEVED_HALF) &&
            t->stages[i].seconds > EARLY * t->whole_left)
            return true;
    return false;
}

void kiln_time_left_update(struct kiln_time_left *t, double now)
{
    const double passed = fmax(now - t->updated, 0.0), before = t->whole_left;
    t->updated = now;
    if (t->count == 0 || is_unknown(t))
        return;
    t->whole_left = left_of_whole(t, now);
    if (before >= 0.0)
        t->whole_left += (fmax(before - passed, 0.0) - t->whole_left) * exp(-passed / KILN_TIME_LEFT_SMOOTH);
    const double most = fmax(is_rough(t) ? EARLY : NEARLY, t->whole_share),
                 since = before >= 0.0 ? passed : now - t->begin;
    if (since > 0.0)
        t->whole_share = fmin(1.0 - (1.0 - t->whole_share) * t->whole_left / (t->whole_left + since), most);
}
