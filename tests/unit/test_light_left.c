#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>

#include "coordinator/integrate/integrator.h"
#include "coordinator/integrate/light_left.h"
#include "coordinator/integrate/quantity.h"
#include "coordinator/job/job.h"
#include "worker/base/memory.h"

enum { BOUNCES = 5, ROUNDS = 4 };

static struct kiln_integrate_settings settings_of(double published)
{
    return (struct kiln_integrate_settings){.integrator = kiln_integrator_find("cells"),
                                            .schedule = KILN_SCHEDULE_LEAN,
                                            .bounces = BOUNCES,
                                            .samples_direct = 512,
                                            .samples_bounce = 32,
                                            .samples_indirect = 512,
                                            .parts = published > 0.0 ? KILN_PARTS : 1,
                                            .published_error = published,
                                            .lights = 1};
}

/* A bake that never was: steps, and what each takes. A sample of a gather takes twice what one of direct light takes,
 * and a step 0.2 s more. */
struct bake {
    struct kiln_step_reports steps;
    double *seconds;
    size_t room;
};

static double seconds_of(const struct kiln_step *step, double share)
{
    const double sample = step->pass == &kiln_pass_direct ? 0.01 : 0.02;
    return 0.2 + sample * step->samples * (step->samples_field != NULL ? share : 1.0);
}

/* Makes all steps. After round r the error is e / sqrt(samples), and the next one doubles the samples of the half of
 * the points that have not enough, until ROUNDS. */
static void make(struct bake *b, const struct kiln_integrate_settings *settings, double error)
{
    struct kiln_step step;
    double share = 1.0, samples = 1.0;
    while (kiln_steps_next(settings, b->steps.of, b->steps.count, &step)) {
        assert_int_equal(kiln_step_reports_reserve(&b->steps, b->steps.count + 1, NULL), 0);
        assert_int_equal(kiln_grow(&b->seconds, &b->room, b->steps.count + 1, sizeof *b->seconds, "seconds", NULL), 0);
        b->seconds[b->steps.count] = seconds_of(&step, share);
        b->steps.of[b->steps.count++] = (struct kiln_step_report){.step = step};
        if (step.terminal && settings->parts > 1 && (step.part + 1) % KILN_PARTS == 0) {
            struct kiln_step_report *last = &b->steps.of[b->steps.count - 1];
            const uint32_t round = step.part / KILN_PARTS;
            last->unfinished = error / sqrt(samples);
            if (round + 1 < ROUNDS) {
                share *= 0.7;
                last->round = (struct kiln_round){.from = 2 * round, .to = 2 * round + 2, .share = share};
                samples *= 2.0;
            }
        }
    }
}

static void release(struct bake *b)
{
    kiln_free(&b->steps.of);
    kiln_free(&b->seconds);
}

/* Looks at the bake when half of step `at` is done: returns the time left over the true one. */
static double factor_at(const struct bake *b, const struct kiln_integrate_settings *settings, size_t at)
{
    struct kiln_step_reports known = {b->steps.of, at + 1, 0};
    const struct kiln_step_report whole = b->steps.of[at];
    const double seconds = b->seconds[at];
    double left = 0.5 * seconds;
    for (size_t i = at + 1; i < b->steps.count; i++)
        left += b->seconds[i];
    b->seconds[at] = 0.5 * seconds; /* a step under way has no results */
    b->steps.of[at] = (struct kiln_step_report){.step = whole.step};
    const struct kiln_light_so_far so_far = {settings, &known, b->seconds, 0.5, 0.0};
    const double found = kiln_light_left(&so_far);
    b->seconds[at] = seconds;
    b->steps.of[at] = whole;
    return found / left;
}

/* A bake of fixed samples: from its first bounce on, the time left is within a factor of 2. */
static void test_fixed_samples(void **state)
{
    (void)state;
    const struct kiln_integrate_settings settings = settings_of(0.0);
    struct bake b = {{0}, NULL, 0};
    make(&b, &settings, 0.0);
    assert_true(b.steps.count > BOUNCES);
    for (size_t i = 1; i < b.steps.count; i++) {
        const double factor = factor_at(&b, &settings, i);
        assert_true(factor > 0.5 && factor < 2.0);
    }
    release(&b);
}

/* Rounds: before the first one has ended, within a factor of 4; afterwards, by the error reached, of 3. */
static void test_rounds(void **state)
{
    (void)state;
    const struct kiln_integrate_settings settings = settings_of(0.05);
    struct bake b = {{0}, NULL, 0};
    make(&b, &settings, 0.05 * sqrt(8.0));
    assert_true(b.steps.of[b.steps.count - 1].step.part == KILN_PARTS * ROUNDS - 1);
    for (size_t i = 1; i + 1 < b.steps.count; i++) {
        const double factor = factor_at(&b, &settings, i), most = b.steps.of[i].step.part < KILN_PARTS ? 4.0 : 3.0;
        assert_true(factor > 1.0 / most && factor < most);
    }
    release(&b);
}

/* Nothing is known before a step has taken any time. */
/* Rounds that are foretold: by a trial as long as the first is under way, and after a round all that follow it. */
static void test_foretold(void **state)
{
    (void)state;
    const struct kiln_integrate_settings settings = settings_of(0.05);
    struct bake b = {{0}, NULL, 0};
    make(&b, &settings, 0.4);
    size_t at = 0, second = 0;
    double first_round = 0.0, again = 0.0;
    for (; b.steps.of[second].step.part < KILN_PARTS; second++) {
        const struct kiln_step *step = &b.steps.of[second].step;
        first_round += b.seconds[second];
        again += step->bounce == 0 || step->terminal ? b.seconds[second] : 0.0;
        at = second;
    }
    const struct kiln_step_report whole = b.steps.of[at];
    struct kiln_step_reports known = {b.steps.of, at + 1, 0};
    const struct kiln_light_so_far so_far = {&settings, &known, b.seconds, 1.0, 7.0};
    b.steps.of[at] = (struct kiln_step_report){.step = whole.step}; /* under way: it has no results */
    assert_true(fabs(kiln_light_left(&so_far) - 6.0 * again) < 0.02 * again);
    struct kiln_step_report *judged = &b.steps.of[at];
    *judged = whole;
    judged->round = (struct kiln_round){.from = 0, .to = 2, .share = 0.5};
    judged->foretold = (struct kiln_foretold){.tried = 9, .rounds = 2, .samples = 1.5};
    known.count = second + 1;
    const double left = kiln_light_left(&so_far);
    judged->foretold.samples = 0.5; /* this round alone, which has a half of the first's samples */
    const double least = kiln_light_left(&so_far);
    assert_true(least > 0.0 && left > 2.0 * least && left < 4.0 * least && first_round > 0.0);
    release(&b);
}

static void test_unknown(void **state)
{
    (void)state;
    const struct kiln_integrate_settings settings = settings_of(0.0);
    struct bake b = {{0}, NULL, 0};
    struct kiln_light_so_far so_far = {&settings, &b.steps, b.seconds, -1.0, 0.0};
    assert_true(kiln_light_left(&so_far) < 0.0);
    make(&b, &settings, 0.0);
    struct kiln_step_reports first = {b.steps.of, 1, 0};
    so_far = (struct kiln_light_so_far){&settings, &first, b.seconds, 0.0, 0.0};
    assert_true(kiln_light_left(&so_far) < 0.0);
    release(&b);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_fixed_samples),
        cmocka_unit_test(test_rounds),
        cmocka_unit_test(test_foretold),
        cmocka_unit_test(test_unknown),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
