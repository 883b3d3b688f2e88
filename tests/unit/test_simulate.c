/* Tests of the simulation of ranks: imbalance, work stealing and repartitioning. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "coordinator/plan/simulate.h"

enum { CELLS = 64, CELL_POINTS = 50000, SAMPLES = 8 };

/* Roles of "cells" with the lean schedule. */
enum { DIRECT, BOUNCE, FINAL };

struct world {
    struct kiln_integrate_settings settings;
    struct kiln_planned_steps steps;
    uint64_t points[CELLS];
    double cost[KILN_COST_KINDS_MAX][CELLS];
    struct kiln_light_simulation simulation;
};

/* Points of the second half of the cells cost `factor` times as much as those of the first, and these `cost` s for
 * SAMPLES samples. */
static void fill(struct world *w, double cost, double factor)
{
    *w = (struct world){.settings = {.integrator = kiln_integrator_find("cells"),
                                     .bounces = 5,
                                     .samples_direct = SAMPLES,
                                     .samples_bounce = SAMPLES,
                                     .samples_indirect = 8 * SAMPLES,
                                     .work_stealing = true}};
    for (int i = 0; i < CELLS; i++) {
        w->points[i] = CELL_POINTS;
        w->cost[0][i] = i < CELLS / 2 ? cost : factor * cost;
    }
    w->simulation = (struct kiln_light_simulation){.settings = &w->settings,
                                                   .steps = &w->steps,
                                                   .ranks_per_node = 1,
                                                   .cell_points = w->points,
                                                   .cell_count = CELLS,
                                                   .tile_runs = CELLS * CELL_POINTS / 64,
                                                   .threads = 1,
                                                   .computes_for_others = true,
                                                   .moved_bytes = 60.0,
                                                   .bandwidth = 1e9,
                                                   .latency = 1e-5};
}

/* The steps, and what their kinds cost. */
static void plan_steps(struct world *w)
{
    struct kiln_error error;
    assert_int_equal(kiln_planned_steps_make(&w->steps, &w->settings, 7, &error), KILN_OK);
    for (uint32_t k = 0; k < w->steps.kind_count; k++) {
        for (int i = 0; i < CELLS && k > 0; i++)
            w->cost[k][i] = w->cost[0][i] * w->steps.kinds[k].samples / SAMPLES;
        w->simulation.cell_cost[k] = w->cost[k];
    }
}

static struct kiln_simulated_light simulate(struct world *w, uint32_t ranks)
{
    struct kiln_simulated_light light;
    struct kiln_error error;
    plan_steps(w);
    assert_int_equal(kiln_simulate_light(&w->simulation, ranks, 1.0, &light, &error), KILN_OK);
    kiln_planned_steps_release(&w->steps);
    return light;
}

static double seconds(const struct kiln_simulated_light *l)
{
    return l->seconds[0] + l->seconds[1] + l->seconds[2] + l->move;
}

static void even_work_stays(void **state)
{
    (void)state;
    struct world w;
    fill(&w, 1e-5, 1.0);
    const struct kiln_simulated_light light = simulate(&w, 4);
    /* 16 tile runs of 64 points in each 65,536 are tried */
    assert_true(fabs(light.trial - CELLS * CELL_POINTS / 4 * 1e-5 / 64) < 1e-6);
    assert_true(fabs(light.imbalance - 1.0 / 64 / 15) < 1e-9 && fabs(light.kept) < 1e-9 && light.repartitions == 0);
    assert_true(fabs(light.points_most - CELLS * CELL_POINTS / 4) < 1.0);
    assert_true(fabs(seconds(&light) - light.trial - CELLS * CELL_POINTS / 4 * 15e-5) < 1e-6);
}

/* Work of 1 : 3 on two ranks: 3 / 2 - 1 as long as it stays. The trial before the first step finds it. */
static void repartitioned(void **state)
{
    (void)state;
    struct world w;
    fill(&w, 1e-5, 3.0);
    w.settings.rebalance = KILN_REBALANCE_NEVER;
    const struct kiln_simulated_light never = simulate(&w, 2);
    assert_true(fabs(never.kept - 0.5) < 1e-9 && fabs(never.imbalance - 0.5) < 1e-9 && never.repartitions == 0 &&
                never.move == 0.0);
    w.settings.rebalance = KILN_REBALANCE_AUTO;
    const struct kiln_simulated_light automatic = simulate(&w, 2);
    assert_int_equal(automatic.repartitions, 1);
    assert_true(fabs(automatic.kept - 0.5) < 1e-9 && automatic.trial > 0.0);
    assert_true(automatic.first[DIRECT] < 0.02 && automatic.first[BOUNCE] < 0.02 && automatic.last[FINAL] < 0.02);
    assert_true(seconds(&automatic) < 0.8 * seconds(&never) && automatic.points_most > never.points_most);
    w.simulation.keeps_points = true; /* devices */
    assert_int_equal(simulate(&w, 2).repartitions, 0);
    w.settings.rebalance = KILN_REBALANCE_ALWAYS;
    assert_true(simulate(&w, 2).first[BOUNCE] < 0.02);
}

/* Where a move costs more than it wins; and where a bake knows too little of where in a share the costly points are. */
static void does_not_pay(void **state)
{
    (void)state;
    struct world w;
    fill(&w, 1e-9, 3.0);
    assert_int_equal(simulate(&w, 2).repartitions, 0);
    fill(&w, 2e-7, 3.0);    /* so little that a batch is a whole share */
    w.settings.bounces = 2; /* one more cut, after the only bounce; a share of the three has costs of 1 and 3 */
    w.simulation.part_points = 4 * CELLS * CELL_POINTS;
    const struct kiln_simulated_light coarse = simulate(&w, 3);
    w.simulation.part_points = CELL_POINTS / 10;
    const struct kiln_simulated_light fine = simulate(&w, 3);
    assert_true(coarse.repartitions == 2 && fine.repartitions == 1);
    assert_true(coarse.first[DIRECT] > 0.1 && fine.first[DIRECT] < 0.06 && coarse.first[FINAL] < 0.06);
}

static void stolen_work(void **state)
{
    (void)state;
    struct world w;
    fill(&w, 1e-5, 3.0);
    w.simulation.ranks_per_node = 2;
    const struct kiln_simulated_light together = simulate(&w, 2);
    assert_true(together.repartitions == 0 && together.imbalance > 0.0 && together.imbalance < 0.01 &&
                fabs(together.kept - 0.5) < 1e-9);
    w.simulation.shared_memory_ranks = 1;
    assert_true(simulate(&w, 2).repartitions == 1);
    w.simulation.shared_memory_ranks = 0;
    w.settings.work_stealing = false;
    assert_true(simulate(&w, 2).repartitions == 1);
    w.settings.work_stealing = true;
    w.simulation.keeps_points = true;
    assert_true(simulate(&w, 2).imbalance < 0.01); /* devices of one host */
    w.simulation.computes_for_others = false;
    assert_true(fabs(simulate(&w, 2).imbalance - 0.5) < 1e-9);
    fill(&w, 1e-5, 3.0); /* two nodes of two: within a node all is even, between them it is not */
    w.simulation.ranks_per_node = 2;
    const struct kiln_simulated_light nodes = simulate(&w, 4);
    assert_true(nodes.repartitions == 1 && nodes.first[DIRECT] < 0.03 && nodes.last[FINAL] < 0.03);
}

/* One of two ranks takes three times as long: alone 3 / 2 - 1 too much; with help both end after 3 / 4 of that mean;
 * and repartitions by what points cost where they are now come nearer to that each time. */
static void slow_rank(void **state)
{
    (void)state;
    struct world w;
    fill(&w, 1e-5, 1.0);
    w.settings.faults = (struct kiln_faults){.slow_rank = 1, .slowness = 3.0};
    w.settings.rebalance = KILN_REBALANCE_NEVER;
    const struct kiln_simulated_light alone = simulate(&w, 2);
    assert_true(fabs(alone.imbalance - 0.5) < 1e-9);
    w.settings.rebalance = KILN_REBALANCE_AUTO;
    const struct kiln_simulated_light after = simulate(&w, 2);
    assert_true(after.repartitions >= 2 && after.last[FINAL] < 0.1 && seconds(&after) < 0.7 * seconds(&alone));
    w.simulation.ranks_per_node = 2;
    const struct kiln_simulated_light helped = simulate(&w, 2);
    assert_true(fabs(seconds(&helped) / seconds(&alone) - 0.5) < 0.01);
}

static struct kiln_scaled simulate_saving(struct world *w, uint32_t ranks, double every, double bandwidth)
{
    const struct kiln_simulation simulation = {
        .light = w->simulation, .saved_bytes = 40.0, .saved_bandwidth = bandwidth, .save_every = every};
    struct kiln_scaled scaled;
    struct kiln_error error;
    assert_int_equal(kiln_simulate(&simulation, ranks, 1.0, &scaled, &error), KILN_OK);
    return scaled;
}

/* 480 s of light in seven steps, and checkpoints of 128 MB. */
static void checkpoints(void **state)
{
    (void)state;
    struct world w;
    fill(&w, 1e-5, 1.0);
    plan_steps(&w);
    const struct kiln_scaled never = simulate_saving(&w, 1, 0.0, 1e9), often = simulate_saving(&w, 1, 10.0, 1e9);
    assert_true(never.saves == 0.0 && never.save == 0.0);
    assert_true(often.saves == floor(often.trace / 10.0) && often.saves > 7.0);
    assert_true(fabs(often.save / often.saves - 0.13) < 0.01);
    assert_true(fabs(often.seconds - never.seconds - often.save) < 1e-9);
    /* rarely within a pass, but after each step, which is cheap: 0.13 s in over 6.5 s */
    assert_true(simulate_saving(&w, 1, 1e6, 1e9).saves == (double)w.steps.count);
    /* a slow disk: at most 2 % of the time, and not after each step */
    const struct kiln_scaled slow = simulate_saving(&w, 1, 1e6, 2e7);
    assert_true(slow.saves == 1.0 && slow.save > 6.0 && slow.save < 0.02 * slow.trace);
    assert_true(simulate_saving(&w, 1, 1e6, 1e7).saves == 0.0);
    /* nodes write beside each other */
    const struct kiln_scaled nodes = simulate_saving(&w, 4, 10.0, 1e9);
    assert_true(nodes.nodes == 4 && fabs(nodes.save / nodes.saves - 0.034) < 0.01);
    kiln_planned_steps_release(&w.steps);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(even_work_stays), cmocka_unit_test(repartitioned),
                                       cmocka_unit_test(does_not_pay),    cmocka_unit_test(stolen_work),
                                       cmocka_unit_test(slow_rank),       cmocka_unit_test(checkpoints)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
