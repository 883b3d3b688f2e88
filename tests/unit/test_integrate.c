/* Tests of integrators: the steps of "cells" for lists of reports; a plan has the same steps as a bake; an integrator
 * that is only defined by a struct in this file works. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "worker/base/memory.h"
#include "coordinator/field/field.h"
#include "coordinator/integrate/companion.h"
#include "coordinator/integrate/cells/cells.h"
#include "coordinator/integrate/cells/late.h"
#include "coordinator/integrate/cells/schedule.h"
#include "coordinator/integrate/parts/part_caustics.h"
#include "coordinator/integrate/quantity.h"
#include "coordinator/plan/simulate_light.h"

enum { STEPS_MOST = 400 };

/* A bake whose first step reflects some power, and each bounce `ratio` to the power of its number, W. */
struct bake {
    struct kiln_integrate_settings settings;
    struct kiln_step_report reports[STEPS_MOST];
    size_t count;
};

static struct kiln_integrate_settings settings_of(enum kiln_schedule schedule, int64_t bounces)
{
    return (struct kiln_integrate_settings){.integrator = kiln_integrator_find("cells"),
                                            .schedule = schedule,
                                            .bounces = bounces,
                                            .samples_direct = 16,
                                            .samples_bounce = 4,
                                            .samples_indirect = 32};
}

/* All steps of the settings. `first`: what each step before the bounces reflects. */
static void all_steps(struct bake *b, double first, double ratio, double tail_error)
{
    b->count = 0;
    struct kiln_step step;
    while (b->settings.integrator->next(&b->settings, b->reports, b->count, &step)) {
        assert_true(b->count < STEPS_MOST);
        struct kiln_step_report *report = &b->reports[b->count];
        *report = (struct kiln_step_report){.step = step, .tail_error = tail_error};
        for (int c = 0; c < 3 && step.role != KILN_CELLS_PILOT; c++)
            report->energy.reflected[c] = step.bounce == 0 ? first : pow(ratio, step.bounce);
        if (step.bounce > 0)
            memcpy(report->energy.sent, b->reports[b->count - 1].energy.reflected, sizeof report->energy.sent);
        b->count++;
    }
}

static void run_with(struct bake *b, double first, enum kiln_schedule schedule, int64_t bounces, double ratio,
                     double tail_error, uint32_t samples_direct)
{
    b->settings = settings_of(schedule, bounces);
    b->settings.samples_direct = samples_direct;
    all_steps(b, first, ratio, tail_error);
}

static void run(struct bake *b, enum kiln_schedule schedule, int64_t bounces, double ratio, double tail_error)
{
    run_with(b, 1.0, schedule, bounces, ratio, tail_error, 16);
}

static void expect(const struct kiln_step *step, uint32_t role, uint32_t bounce, uint32_t samples, uint32_t stream,
                   bool counted)
{
    assert_int_equal(step->role, role);
    assert_int_equal(step->pass, role == KILN_CELLS_DIRECT ? &kiln_pass_direct : &kiln_pass_gather);
    assert_int_equal(step->bounce, bounce);
    assert_int_equal(step->samples, samples);
    assert_int_equal(step->stream, stream);
    assert_int_equal(step->counted, counted);
}

/* Samples of a bounce with samples_bounce = 4: more in the first bounces, and 2 at least. */
static uint32_t bounce_samples(uint32_t bounce) { return bounce == 1 ? 12 : bounce == 2 ? 6 : bounce == 3 ? 4 : 2; }

static void lean_given(void **state)
{
    (void)state;
    static struct bake b;
    for (int64_t bounces = 0; bounces <= 6; bounces++) {
        run(&b, KILN_SCHEDULE_LEAN, bounces, 0.5, 1.0);
        assert_int_equal(b.count, bounces + 1);
        expect(&b.reports[0].step, KILN_CELLS_DIRECT, 0, 16, 0, true);
        for (uint32_t i = 1; i < b.count; i++)
            if (i + 1 < b.count)
                expect(&b.reports[i].step, KILN_CELLS_BOUNCE, i, bounce_samples(i), i, false);
            else
                expect(&b.reports[i].step, KILN_CELLS_FINAL, i, 32, 0xffff, true);
    }
}

/* With many samples direct light has a pilot, whose energy does not count; the steps after it are as without one, and
 * end by the same rule. */
static void pilot(void **state)
{
    (void)state;
    static struct bake b, plain;
    for (int64_t bounces = -1; bounces <= 6; bounces++) {
        run(&plain, KILN_SCHEDULE_LEAN, bounces, 0.5, 1e-3);
        run_with(&b, 1.0, KILN_SCHEDULE_LEAN, bounces, 0.5, 1e-3, 256);
        assert_int_equal(b.count, plain.count + 1);
        assert_true(b.reports[0].step.role == KILN_CELLS_PILOT && b.reports[0].step.samples == 32);
        assert_true(b.reports[0].step.samples_field == NULL && b.reports[0].step.stream == 0);
        expect(&b.reports[1].step, KILN_CELLS_DIRECT, 0, 224, KILN_CELLS_DIRECT_STREAM, true);
        assert_string_equal(b.reports[1].step.samples_field, KILN_FIELD_SAMPLES);
        for (size_t i = 1; i < plain.count; i++) {
            const struct kiln_step *step = &plain.reports[i].step;
            expect(&b.reports[i + 1].step, step->role, step->bounce, step->samples, step->stream, step->counted);
        }
    }
    for (size_t lights = 16; lights <= 17; lights++) {
        b.settings.lights = lights;
        assert_true(b.settings.integrator->next(&b.settings, b.reports, 0, &b.reports[0].step));
        assert_int_equal(b.reports[0].step.role, lights == 16 ? KILN_CELLS_PILOT : KILN_CELLS_DIRECT);
        assert_int_equal(b.reports[0].step.samples, lights == 16 ? 32 : 256);
    }
    run_with(&b, 1.0, KILN_SCHEDULE_EQUAL, 0, 0.5, 1.0, 256);
    assert_int_equal(b.count, 1);
    expect(&b.reports[0].step, KILN_CELLS_DIRECT, 0, 256, 0, true);
}

/* Caustics are a step after direct light. The bounces are as if both were one, and end by the same rule. */
static void caustics(void **state)
{
    (void)state;
    static struct bake b, plain;
    static const uint32_t direct[] = {16, 256}; /* the latter with a pilot */
    for (size_t d = 0; d < 2; d++)
        for (int64_t bounces = -1; bounces <= 6; bounces++) {
            const size_t first = d + 1;
            run_with(&plain, 1.0, KILN_SCHEDULE_LEAN, bounces, 0.85, 1e-3, direct[d]);
            b.settings = plain.settings;
            b.settings.caustics = KILN_CAUSTICS_GATHER;
            all_steps(&b, 0.5, 0.85, 1e-3);
            assert_int_equal(b.count, plain.count + 1);
            assert_int_equal(b.reports[first - 1].step.role, KILN_CELLS_DIRECT);
            assert_int_equal(kiln_cells_first(&b.settings), first);
            assert_true(b.reports[first].step.pass == &kiln_pass_caustic && b.reports[first].step.counted);
            assert_int_equal(b.reports[first].step.role, KILN_CELLS_CAUSTIC);
            assert_int_equal(b.reports[first].step.samples, 32);
            for (size_t i = first; i < plain.count; i++) {
                const struct kiln_step *step = &plain.reports[i].step;
                expect(&b.reports[i + 1].step, step->role, step->bounce, step->samples, step->stream, step->counted);
            }
        }
}

/* Without a number: at least three bounces, until a tail is good enough, or nothing is left, or it is plain that they
 * have no end. A ratio above 0.8 is believed after eight bounces, unless what is left hardly matters. */
static void lean_all(void **state)
{
    (void)state;
    static struct bake b;
    run(&b, KILN_SCHEDULE_LEAN, -1, 0.5, 1.9e-3);
    assert_int_equal(b.count, 1 + 3 + 1);
    assert_int_equal(b.reports[4].step.role, KILN_CELLS_FINAL);
    run(&b, KILN_SCHEDULE_LEAN, -1, 0.5, 2.1e-3); /* 2^-23 is the first below 1e-7 of 2 */
    assert_int_equal(b.count, 1 + 23 + 1);
    run(&b, KILN_SCHEDULE_LEAN, -1, 0.0, 1.0);
    assert_int_equal(b.count, 1 + 1 + 1);
    run(&b, KILN_SCHEDULE_LEAN, -1, 0.9, 0.0);
    assert_int_equal(b.count, 1 + KILN_TAIL_BOUNCES + 1);
    run_with(&b, 1e5, KILN_SCHEDULE_LEAN, -1, 0.95, 0.0, 16);
    assert_int_equal(b.count, 1 + 3 + 1);
    run(&b, KILN_SCHEDULE_LEAN, -1, 0.9, 1.0); /* 0.9^132 is the first below 1e-7 of 10 */
    assert_int_equal(b.count, 1 + 132 + 1);
    run(&b, KILN_SCHEDULE_LEAN, -1, 0.99995, 0.0);
    assert_int_equal(b.count, 1 + 32 + 1);
    expect(&b.reports[b.count - 1].step, KILN_CELLS_FINAL, 33, 32, 0xffff, true);
}

/* Late bounces have a field of samples, and only where their number is not given. Their ratio is over the power that
 * they gather for: tiles that have ended do not make it less. */
/* Steps after bounces whose objects' errors are `before` and `last`, and once `most` some bounces earlier. */
static bool goes_on(double most, double before, double last)
{
    const struct kiln_integrate_settings settings = settings_of(KILN_SCHEDULE_LEAN, -1);
    static struct bake b;
    struct kiln_step step;
    run(&b, KILN_SCHEDULE_LEAN, -1, 0.5, 0.0);
    const size_t count = b.count - 1; /* without the final gather */
    assert_true(count >= 3);
    b.reports[count - 3].object_error = most;
    b.reports[count - 2].object_error = before;
    b.reports[count - 1].object_error = last;
    assert_true(settings.integrator->next(&settings, b.reports, count, &step));
    return step.role == KILN_CELLS_BOUNCE;
}

/* A small error in an object's mean does not ask for bounces. A larger one does, until it is small twice. */
static void tiles(void **state)
{
    (void)state;
    assert_false(goes_on(0.0, 0.0, 0.0025));
    assert_true(goes_on(0.0, 0.0, 0.004));
    assert_true(goes_on(0.3, 0.004, 0.0015));
    assert_true(goes_on(0.3, 0.0, 0.0015)); /* the one before was not measured */
    assert_false(goes_on(0.3, 0.0015, 0.0015));
    assert_false(goes_on(0.3, 0.3, 0.0)); /* all tiles have ended */
}

static void late(void **state)
{
    (void)state;
    static struct bake b;
    struct kiln_tail_fit fit;
    for (int64_t bounces = -1; bounces <= 20; bounces += 21) {
        run_with(&b, 1.0, KILN_SCHEDULE_LEAN, bounces, 0.9, 1.0, 256);
        assert_true(b.count > 20);
        for (size_t i = 2; i + 1 < b.count; i++) {
            const bool is_late = bounces < 0 && b.reports[i].step.bounce >= KILN_LATE_FIRST;
            assert_int_equal(kiln_late_is(&b.reports[i].step), is_late);
            assert_true(is_late == (b.reports[i].step.samples_field != NULL));
        }
        assert_false(kiln_late_is(&b.reports[1].step) || kiln_late_is(&b.reports[b.count - 1].step));
    }
    run(&b, KILN_SCHEDULE_LEAN, -1, 0.9, 1.0);
    for (size_t i = 14; i < b.count; i++) /* half of the power ends before bounce 14 */
        for (int c = 0; c < 3; c++) {
            b.reports[i].energy.reflected[c] *= 0.5;
            b.reports[i].energy.sent[c] *= 0.5;
        }
    kiln_cells_fit_tail(b.reports, 20, &fit);
    assert_true(fit.is_long && fabs(kiln_cells_ratio(b.reports, 14) - 0.9) < 1e-12);
    for (int c = 0; c < 3; c++)
        assert_true(fabs(fit.ratio[c] - 0.9) < 1e-12 && fabs(fit.latest[c] - 0.9) < 1e-12);
}

/* The rays of a bounce fall with its number. */
static void falling(void **state)
{
    (void)state;
    static struct bake b;
    static const uint32_t expected[] = {48, 24, 16, 8, 8, 4, 4, 4};
    struct kiln_step step;
    run(&b, KILN_SCHEDULE_LEAN, 9, 0.5, 1.0);
    b.settings.samples_bounce = 16;
    for (size_t i = 0; i < 8; i++) {
        assert_true(b.settings.integrator->next(&b.settings, b.reports, i + 1, &step));
        assert_int_equal(step.samples, expected[i]);
    }
    run(&b, KILN_SCHEDULE_LEAN, 9, 0.81, 1.0); /* a long tail */
    b.settings.samples_bounce = 16;
    for (size_t i = 0; i < 8; i++) {
        assert_true(b.settings.integrator->next(&b.settings, b.reports, i + 1, &step));
        assert_int_equal(step.samples, expected[i] > 16 ? expected[i] : 16);
    }
    run(&b, KILN_SCHEDULE_LEAN, 9, 0.5, 1.0);
    b.settings.samples_bounce = 1048576; /* the most that the option takes */
    assert_true(b.settings.integrator->next(&b.settings, b.reports, 1, &step) && step.samples == 3145728);
    b.settings.samples_bounce = 1;
    assert_true(b.settings.integrator->next(&b.settings, b.reports, 1, &step) && step.samples == 3);
    assert_true(b.settings.integrator->next(&b.settings, b.reports, 8, &step) && step.samples == 2);
}

static void equal(void **state)
{
    (void)state;
    static struct bake b;
    for (int64_t bounces = 0; bounces <= 6; bounces++) {
        run(&b, KILN_SCHEDULE_EQUAL, bounces, 0.0, 1.0);
        assert_int_equal(b.count, bounces + 1);
        for (uint32_t i = 1; i < b.count; i++)
            expect(&b.reports[i].step, KILN_CELLS_BOUNCE, i, 32, i, true);
    }
    run(&b, KILN_SCHEDULE_EQUAL, -1, 0.5, 1.0); /* 2^-16 is the first below 1e-5 of 2 */
    assert_int_equal(b.count, 1 + 16);
    run(&b, KILN_SCHEDULE_EQUAL, -1, 1.0, 1.0);
    assert_int_equal(b.count, 1 + KILN_BOUNCES_ALL);
}

/* Radiosity travels in 4 bytes, and early, only where another bounce surely or probably gathers from it; and not in 4
 * bytes where a long tail would multiply the rounding. */
static void form(void **state)
{
    (void)state;
    static struct bake b;
    struct kiln_step step;
    run(&b, KILN_SCHEDULE_LEAN, 3, 0.9, 1.0);
    b.settings.compact = true;
    for (size_t i = 0; i < b.count; i++) {
        assert_true(b.settings.integrator->next(&b.settings, b.reports, i, &step));
        assert_int_equal(step.compact, i < 3);
        assert_int_equal(step.early, i < 2);
    }
    b.settings.tail = true;
    for (size_t i = 0; i < b.count; i++) {
        assert_true(b.settings.integrator->next(&b.settings, b.reports, i, &step));
        assert_int_equal(step.compact, i < 2); /* the ratio of two steps is known from the third on */
    }
    b.settings.bounces = -1;
    assert_true(b.settings.integrator->next(&b.settings, b.reports, 1, &step) && step.compact && step.early);
    b.settings.schedule = KILN_SCHEDULE_EQUAL;
    assert_true(b.settings.integrator->next(&b.settings, b.reports, 1, &step) && !step.compact && !step.early);
}

/* Without any energies, a plan has the steps that a bake has with them. */
static void plan_as_bake(void **state)
{
    (void)state;
    static struct bake b;
    struct kiln_error error;
    for (int schedule = KILN_SCHEDULE_LEAN; schedule <= KILN_SCHEDULE_EQUAL; schedule++)
        for (int64_t bounces = 0; bounces <= 8; bounces++) {
            struct kiln_planned_steps plan;
            run(&b, (enum kiln_schedule)schedule, bounces, 0.7, 0.0);
            assert_int_equal(kiln_planned_steps_make(&plan, &b.settings, 99, &error), KILN_OK);
            assert_int_equal(plan.count, b.count);
            double samples = 0.0;
            for (size_t i = plan.count; i-- > 0;) {
                const struct kiln_step *step = &plan.of[i].step;
                expect(step, b.reports[i].step.role, b.reports[i].step.bounce, b.reports[i].step.samples,
                       b.reports[i].step.stream, b.reports[i].step.counted);
                assert_ptr_equal(plan.kinds[plan.of[i].kind].pass, step->pass);
                assert_int_equal(plan.kinds[plan.of[i].kind].samples, step->samples);
                samples += step->samples;
                assert_true(plan.of[i].outlook.steps == plan.count - i && plan.of[i].outlook.samples == samples);
            }
            kiln_planned_steps_release(&plan);
        }
}

/* A bake that does not know its number of bounces expects three after the next one; the plan of it has seven, and sees
 * at each of them what the bake will see. */
static void outlook(void **state)
{
    (void)state;
    static struct bake b;
    struct kiln_error error;
    struct kiln_planned_steps plan;
    struct kiln_step_reports reports = {NULL, 0, 0};
    run(&b, KILN_SCHEDULE_LEAN, -1, 0.5, 1e-3);
    assert_int_equal(kiln_step_reports_reserve(&reports, b.count, &error), KILN_OK);
    memcpy(reports.of, b.reports, b.count * sizeof *reports.of);
    assert_int_equal(kiln_planned_steps_make(&plan, &b.settings, 7, &error), KILN_OK);
    assert_int_equal(plan.count, 8);
    for (size_t i = 1; i < b.count; i++) {
        const struct kiln_step step = reports.of[i].step; /* as the bake's next says */
        struct kiln_outlook bake;
        reports.count = i;
        assert_int_equal(kiln_integrate_outlook(&b.settings, &reports, &step, &bake, &error), KILN_OK);
        memcpy(reports.of, b.reports, b.count * sizeof *reports.of); /* what lies beyond the count was used */
        const bool last = i + 1 == b.count;
        assert_int_equal(bake.steps, last ? 1 : 4);
        double samples = 32.0;
        for (uint32_t k = 0; k < 3 && !last; k++)
            samples += bounce_samples((uint32_t)i + k);
        assert_true(bake.samples == samples);
        if (!last)
            assert_true(plan.of[i].outlook.steps == bake.steps && plan.of[i].outlook.samples == bake.samples);
    }
    assert_true(plan.of[7].outlook.steps == 1 && plan.of[7].outlook.samples == 32.0);
    kiln_planned_steps_release(&plan);
    kiln_free(&reports.of);
}

static void table(void **state)
{
    (void)state;
#define NAME(name) #name,
    static const char *const names[] = {KILN_METHOD_LIST(NAME)};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        const struct kiln_integrator *integrator = kiln_integrator_find(names[i]);
        assert_non_null(integrator);
        assert_string_equal(integrator->name, names[i]);
        assert_true(integrator->role_count > 0 && integrator->role_count <= KILN_ROLES_MAX);
        assert_true(kiln_integrator_has_phase(integrator->roles[0].phase));
    }
    assert_null(kiln_integrator_find("radiosity of the moon"));
    assert_false(kiln_integrator_has_phase("exchange"));
}

/* ---- an integrator that is not in the table ---- */

/* Direct light again and again, with twice the samples each time. */
static bool doubling_next(const struct kiln_integrate_settings *settings, const struct kiln_step_report *reports,
                          size_t count, struct kiln_step *step)
{
    (void)reports;
    *step = (struct kiln_step){.pass = &kiln_pass_direct,
                               .role = count > 0,
                               .bounce = (uint32_t)count,
                               .samples = settings->samples_direct << count,
                               .counted = true};
    return (int64_t)count <= settings->bounces;
}

static const struct kiln_role doubling_roles[] = {{"coarse", "coarse", "coarse light", "coarse light", false, false},
                                                  {"fine", "fine", "finer light", "finer light", true, false}};
static const struct kiln_integrator doubling = {
    .name = "doubling", .roles = doubling_roles, .role_count = 2, .next = doubling_next};

/* Two ranks, one of which has points that cost three times as much: planned, simulated and distributed anew, by no more
 * than the struct above. */
static void another_integrator(void **state)
{
    (void)state;
    enum { CELLS = 2, POINTS = 100000 };
    const struct kiln_integrate_settings settings = {
        .integrator = &doubling, .bounces = 3, .samples_direct = 5, .work_stealing = true};
    const uint64_t points[CELLS] = {POINTS, POINTS};
    double cost[4][CELLS];
    struct kiln_planned_steps steps;
    struct kiln_simulated_light light;
    struct kiln_error error;
    assert_int_equal(kiln_planned_steps_make(&steps, &settings, 7, &error), KILN_OK);
    assert_true(steps.count == 4 && steps.kind_count == 4 && steps.of[3].step.samples == 40);
    assert_true(steps.of[1].outlook.steps == 3 && steps.of[1].outlook.samples == 10.0 + 20.0 + 40.0);
    struct kiln_light_simulation simulation = {.settings = &settings,
                                               .steps = &steps,
                                               .cell_points = points,
                                               .cell_count = CELLS,
                                               .tile_runs = 1u << 16,
                                               .threads = 1,
                                               .computes_for_others = true,
                                               .moved_bytes = 60.0,
                                               .bandwidth = 1e9,
                                               .latency = 1e-5};
    for (uint32_t k = 0; k < steps.kind_count; k++) {
        for (int i = 0; i < CELLS; i++)
            cost[k][i] = 1e-5 * (i == 0 ? 1.0 : 3.0) * steps.kinds[k].samples / 5.0;
        simulation.cell_cost[k] = cost[k];
    }
    assert_int_equal(kiln_simulate_light(&simulation, 2, 1.0, &light, &error), KILN_OK);
    kiln_planned_steps_release(&steps);
    /* what is tried before the first step says enough of all, for they run the same pass */
    assert_int_equal(light.repartitions, 1);
    assert_true(fabs(light.seconds[0] - 2.0) < 0.01 && fabs(light.seconds[1] - 2.0 * (2 + 4 + 8)) < 0.01);
    assert_true(light.first[0] < 1e-2 && light.last[1] < 1e-2);
}

/* Appends the bake's next step; false: there is none. */
static bool go_on(struct bake *b, const struct kiln_integrate_settings *settings)
{
    struct kiln_step step;
    const bool any = kiln_steps_next(settings, b->reports, b->count, &step);
    assert_true(b->count < sizeof b->reports / sizeof *b->reports);
    if (any)
        b->reports[b->count++] = (struct kiln_step_report){.step = step};
    return any;
}

/* Each part has all steps and a share of the samples, which follow one another. */
static void parts(void **state)
{
    (void)state;
    struct kiln_integrate_settings settings = settings_of(KILN_SCHEDULE_LEAN, 2);
    struct bake b = {.count = 0};
    settings.parts = KILN_PARTS;
    settings.samples_indirect = 30;
    while (go_on(&b, &settings))
        ;
    assert_int_equal(b.count, 3 * KILN_PARTS); /* direct, a bounce, the final gather */
    for (size_t i = 0; i < b.count; i++) {
        const struct kiln_step *step = &b.reports[i].step;
        assert_int_equal(step->part, i / 3);
        assert_int_equal(step->role, b.reports[i % 3].step.role);
        assert_int_equal(step->samples, b.reports[i % 3].step.samples);
        assert_int_equal(step->first_sample, step->part * step->samples);
        assert_true(step->counted == b.reports[i % 3].step.counted && step->samples_field == NULL);
    }
    assert_int_equal(b.reports[2].step.samples, 8); /* 30, rounded up, by 4 */
}

/* No two steps of a role have a sample of the sequence in common, and those that count leave none out. */
static void assert_stretches(const struct bake *b)
{
    for (size_t i = 0; i < b->count; i++) {
        const struct kiln_step *one = &b->reports[i].step;
        uint32_t before = 0;
        for (size_t j = 0; j < i; j++) {
            const struct kiln_step *other = &b->reports[j].step;
            if (other->role != one->role)
                continue;
            assert_true(one->first_sample >= other->first_sample + other->samples);
            before += other->samples;
        }
        if (one->role == b->reports[0].step.role || one->terminal)
            assert_int_equal(one->first_sample, before);
    }
}

/* With a target error the first round has few samples; others go from level to level, and what only others gather from
 * has fewer by the square root of the points that are not finished. */
static void rounds(void **state)
{
    (void)state;
    static const struct kiln_round next[] = {
        {0, 3, 0.25, 0, 0}, {3, 4, 1.0, 0, 0}, {4, 5, 0.04, 0, 0}, {5, 9, 0.5, 0, 0}};
    enum { ROUNDS = 1 + sizeof next / sizeof *next, STEPS = 3 * KILN_PARTS };
    struct kiln_integrate_settings settings = settings_of(KILN_SCHEDULE_LEAN, 2);
    struct bake b = {.count = 0};
    settings.parts = KILN_PARTS;
    settings.target_error = 0.01;
    settings.samples_direct = settings.samples_indirect = 30;
    settings.samples_bounce = 11; /* 33 in the first bounce */
    for (size_t r = 0; r < ROUNDS; r++) {
        while (go_on(&b, &settings))
            ;
        assert_int_equal(b.count, STEPS * (r + 1));
        b.reports[b.count - 1].round = r + 1 < ROUNDS ? next[r] : (struct kiln_round){.from = 9, .share = 0.1};
        const struct kiln_step *last = &b.reports[b.count - 1].step, *first = &b.reports[STEPS * r].step;
        assert_true(last->terminal && last->counted == (r == 0) && first->counted == (r == 0));
        if (r > 0) {
            assert_string_equal(last->samples_field, KILN_FIELD_SAMPLES);
            assert_string_equal(first->samples_field, KILN_FIELD_SAMPLES_DIRECT);
            assert_null(b.reports[STEPS * r + 1].step.samples_field);
        }
    }
    assert_false(go_on(&b, &settings));
    assert_stretches(&b);
    /* of 30 samples a part of the first round has 2, an even number; level 3 is three times as many in all */
    assert_int_equal(b.reports[2].step.samples, 2);
    assert_int_equal(b.reports[STEPS + 2].step.samples, 4);
    assert_int_equal(b.reports[2 * STEPS + 2].step.samples, 2);
    assert_int_equal(b.reports[4 * STEPS + 2].step.samples, 48 - 12);
    assert_int_equal(b.reports[1].step.samples, 3);
    assert_int_equal(b.reports[STEPS + 1].step.samples, 2); /* 3 times 2, of which a quarter, rounded up */
}

/* The light paths of rounds: no two steps share any. Where iterations grow they follow one another, and go by the
 * samples of the step; else each step has the same number. */
static void try_light_paths(uint32_t iterations, bool grow)
{
    static const struct kiln_round next[] = {{0, 1, 0.5, 0, 0}, {1, 3, 0.25, 0, 0}, {3, 9, 0.1, 0, 0}};
    enum { ROUNDS = 1 + sizeof next / sizeof *next };
    struct kiln_integrate_settings settings = settings_of(KILN_SCHEDULE_LEAN, 0);
    struct bake b = {.count = 0};
    uint64_t before = 0;
    size_t steps = 0;
    settings.parts = KILN_PARTS;
    settings.target_error = 0.01;
    settings.samples_indirect = 96; /* 6 in a part of the first round */
    settings.caustics = KILN_CAUSTICS_VCM;
    settings.iterations = iterations;
    settings.iterations_grow = grow;
    for (size_t r = 0; r < ROUNDS; r++) {
        while (go_on(&b, &settings))
            ;
        b.reports[b.count - 1].round = r + 1 < ROUNDS ? next[r] : (struct kiln_round){.from = 9, .share = 0.1};
    }
    for (size_t i = 0; i < b.count; i++) {
        const struct kiln_step *step = &b.reports[i].step;
        assert_int_equal(step->iterations > 0, kiln_step_has(step, KILN_WITH(landing)));
        if (!kiln_step_has(step, KILN_WITH(landing)))
            continue;
        assert_int_equal(step->first_iteration, before);
        assert_int_equal(step->iterations, grow ? iterations * step->samples / 6 : iterations);
        before += step->iterations;
        steps++;
    }
    assert_int_equal(steps, ROUNDS * KILN_PARTS);
    /* 24 times the samples of the first round in all, level 9 */
    assert_int_equal(before, grow ? 24 * KILN_PARTS * iterations : ROUNDS * KILN_PARTS * iterations);
}

static void light_paths(void **state)
{
    (void)state;
    try_light_paths(KILN_ITERATIONS_FIRST, true);
    try_light_paths(7, false);
}

/* With an error of published light a round has caustics by levels of their own, or none; their samples and light paths
 * follow those of the last round that had any. */
static void caustic_rounds(void **state)
{
    (void)state;
    static const struct kiln_round next[] = {
        {0, 3, 0.5, 0, 0}, {3, 5, 0.25, 0, 2}, {5, 6, 0.25, 2, 2}, {6, 9, 0.1, 2, 6}};
    static const uint32_t times[] = {1, 0, 1, 0, 6}; /* levels 0, 2 and 6: 1, 2 and 8 in all */
    enum { ROUNDS = 1 + sizeof next / sizeof *next, SAMPLES = 6, ITERATIONS = 4 };
    struct kiln_integrate_settings settings = settings_of(KILN_SCHEDULE_LEAN, 1);
    struct bake b = {.count = 0};
    uint32_t samples = 0, iterations = 0, steps[ROUNDS] = {0};
    settings.parts = KILN_PARTS;
    settings.published_error = 0.05;
    settings.samples_indirect = 16 * SAMPLES;
    settings.caustics = KILN_CAUSTICS_VCM;
    settings.iterations = ITERATIONS;
    for (size_t r = 0; r < ROUNDS; r++) {
        while (go_on(&b, &settings))
            ;
        b.reports[b.count - 1].round = r + 1 < ROUNDS ? next[r] : (struct kiln_round){.from = 9};
    }
    for (size_t i = 0; i < b.count; i++) {
        const struct kiln_step *step = &b.reports[i].step;
        if (!kiln_step_has(step, KILN_WITH(landing)))
            continue;
        const uint32_t r = step->part / KILN_PARTS;
        assert_int_equal(step->samples, SAMPLES * times[r]);
        assert_int_equal(step->iterations, ITERATIONS * times[r]);
        assert_int_equal(step->first_sample, samples);
        assert_int_equal(step->first_iteration, iterations);
        assert_null(step->samples_field);
        samples += step->samples;
        iterations += step->iterations;
        steps[r]++;
    }
    for (size_t r = 0; r < ROUNDS; r++)
        assert_int_equal(steps[r], times[r] > 0 ? KILN_PARTS : 0);
}

/* The samples that caustics should have are those of least variance at equal cost. */
static void caustic_growth(void **state)
{
    (void)state;
    struct kiln_caustics_need need = {0}, little = {0};
    kiln_caustics_need_add(&need, 64, 2.0, 0.5);
    kiln_caustics_need_add(&need, 64, 1e9, 0.5); /* bounded */
    kiln_caustics_need_add(&little, 64, 2.0, 0.009);
    assert_true(kiln_caustics_growth(&little, 1.0, 1.0, 0.5) <= 0.0);
    const double even = kiln_caustics_growth(&need, 1.0, 1.0, 1.0);
    assert_true(even > 0.0 && even <= 1.0);                                              /* their cost is not less */
    assert_true(fabs(kiln_caustics_growth(&need, 1.0, 1.0, 0.25) - 0.5 * even) < 1e-12); /* at all points */
    assert_true(fabs(kiln_caustics_growth(&need, 4.0, 1.0, 1.0) - 0.5 * even) < 1e-12);  /* they have had more */
    assert_true(fabs(kiln_caustics_growth(&need, 4.0, 16.0, 1.0) - 2.0 * even) < 1e-12);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(lean_given),
                                       cmocka_unit_test(pilot),
                                       cmocka_unit_test(caustics),
                                       cmocka_unit_test(lean_all),
                                       cmocka_unit_test(tiles),
                                       cmocka_unit_test(late),
                                       cmocka_unit_test(falling),
                                       cmocka_unit_test(equal),
                                       cmocka_unit_test(form),
                                       cmocka_unit_test(plan_as_bake),
                                       cmocka_unit_test(outlook),
                                       cmocka_unit_test(table),
                                       cmocka_unit_test(another_integrator),
                                       cmocka_unit_test(parts),
                                       cmocka_unit_test(rounds),
                                       cmocka_unit_test(light_paths),
                                       cmocka_unit_test(caustic_rounds),
                                       cmocka_unit_test(caustic_growth)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
