#include "coordinator/integrate/solution.h"

#include "worker/base/memory.h"

void kiln_solution_refresh(struct kiln_solution *solution)
{
    solution->own = kiln_rank_data(solution->node_data, kiln_node_data_own(solution->node_data));
    solution->direct = solution->own->direct;
    solution->indirect = solution->own->sum;
    solution->error = solution->own->error;
    solution->report.steals_work = kiln_node_data_count(solution->node_data) > 1;
}

void kiln_sight_destroy(struct kiln_sight **sight)
{
    if (*sight != NULL) {
        kiln_free(&(*sight)->first);
        kiln_free(&(*sight)->pairs);
    }
    kiln_free(sight);
}

void kiln_solution_destroy(struct kiln_solution **solution)
{
    struct kiln_solution *s = *solution;
    if (s == NULL)
        return;
    kiln_node_data_destroy(&s->node_data);
    kiln_radiosity_allgather_destroy(&s->allgather);
    kiln_sight_destroy(&s->sight);
    kiln_free(&s->report.steps.of);
    kiln_free(solution);
}
