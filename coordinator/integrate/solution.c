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

void kiln_solution_destroy(struct kiln_solution **solution)
{
    struct kiln_solution *s = *solution;
    if (s == NULL)
        return;
    kiln_node_data_destroy(&s->node_data);
    kiln_radiosity_allgather_destroy(&s->allgather);
    kiln_free(&s->report.steps.of);
    kiln_free(solution);
}

size_t kiln_solution_bytes(uint64_t own, uint64_t total)
{
    return (size_t)total * sizeof(uint64_t) + (size_t)own * (sizeof(uint64_t) + 6 * sizeof(float) + sizeof(uint16_t));
}
