#include "coordinator/integrate/integrate.h"

#include <math.h>
#include <string.h>

#include "coordinator/integrate/companion.h"
#include "coordinator/integrate/run/lockstep.h"
#include "coordinator/integrate/quantity.h"
#include "coordinator/integrate/run/repartition_rule.h"
#include "coordinator/mpi/agree.h"
#include "worker/base/memory.h"

/* ---- making ---- */

/* Collective on the node. Whether ranks of this node may compute for each other. All must want it and be able to, and
 * devices must be of one kind, since the bits of their results differ. */
static bool steals_work(const struct kiln_integrate_params *p, const struct kiln_backend_info *info)
{
    char first[sizeof info->device];
    memcpy(first, info->device, sizeof first);
    kiln_node_broadcast(p->node, first, sizeof first);
    const bool alike = !info->keeps_points || strcmp(first, info->device) == 0;
    int steals = p->settings->work_stealing && info->computes_for_others && alike;
    (void)MPI_Allreduce(MPI_IN_PLACE, &steals, 1, MPI_INT, MPI_LAND, kiln_node_communicator(p->node));
    return steals != 0;
}

/* Collective. */
static int make_data(struct kiln_lockstep *l, struct kiln_error *error)
{
    const struct kiln_integrate_params *p = l->params;
    struct kiln_backend_info info;
    kiln_backend_info(p->backend, &info);
    int status =
        kiln_node_data_create(&l->solution->node_data, p->node, p->surface, p->fields, steals_work(p, &info), error);
    if (status == KILN_OK) {
        kiln_node_data_set_radiosity(l->solution->node_data, l->solution->radiosity);
        kiln_solution_refresh(l->solution);
        /* the surface's arrays may have moved, so the backend is told; `any_keeps`: a device keeps data of points */
        if (p->backend->given.surface != p->surface)
            status = kiln_backend_set_surface(p->backend, p->surface, error);
    }
    int any_keeps = info.keeps_points;
    (void)MPI_Allreduce(MPI_IN_PLACE, &any_keeps, 1, MPI_INT, MPI_LOR, p->communicator);
    l->may_repartition = kiln_repartition_is_allowed(p->settings->rebalance, any_keeps != 0);
    return kiln_agree(p->communicator, status, error);
}

/* Collective. */
static int make_allgather(struct kiln_lockstep *l, struct kiln_error *error)
{
    const struct kiln_integrate_params *p = l->params;
    const struct kiln_radiosity_allgather_params params = {.communicator = p->communicator,
                                                           .node = p->node,
                                                           .total = p->surface->point_count,
                                                           .first = p->surface->first,
                                                           .count = p->surface->count,
                                                           .trace = p->trace,
                                                           .threads = p->threads,
                                                           .limit = p->settings->exchange_limit};
    const int status = kiln_radiosity_allgather_create(&l->solution->allgather, &params, error);
    if (status == KILN_OK)
        l->solution->radiosity = kiln_radiosity_allgather_values(l->solution->allgather);
    return status;
}

/* Chooses the scale of the 4-byte form of radiosity from the emitted power. */
static void choose_scale(struct kiln_lockstep *l)
{
    const double area = l->params->area > 0.0 ? l->params->area : 1.0;
    kiln_radiosity_allgather_set_scale(l->solution->allgather, ldexp(1.0, ilogb(kiln_ledger_power(&l->ledger) / area)));
}

/* ---- running ---- */

/* The balance of the steps, with what the integrator and the companions know of it. */
static void close_energy(struct kiln_lockstep *l)
{
    const struct kiln_integrate_settings *settings = l->params->settings;
    struct kiln_integrate_report *report = &l->solution->report;
    struct kiln_energy_closing closing = {.caustics = settings->caustics, .albedo_scale = 1.0};
    if (settings->integrator->close != NULL)
        settings->integrator->close(settings, &closing);
    kiln_company_close(&l->company, &closing);
    kiln_energy_close(&report->energy, &report->steps, l->params->emission, &closing);
}

/* Collective. Runs all steps, and derives the results. */
static int integrate(struct kiln_lockstep *l, struct kiln_error *error)
{
    const struct kiln_integrate_params *p = l->params;
    struct kiln_solution *solution = l->solution;
    const bool restored = p->checkpoint != NULL && kiln_checkpoint_generation(p->checkpoint) != 0;
    bool finished = false;
    int status = make_allgather(l, error);
    if (status == KILN_OK) /* allocated after the radiosity, which makes the best use of the node's memory */
        status = make_data(l, error);
    if (status == KILN_OK && p->beside != NULL)
        p->beside->start(p->beside->context, solution->own);
    if (status == KILN_OK && restored)
        status = kiln_restore(&l->saved, &finished, error);
    if (status == KILN_OK)
        status = kiln_company_settle(&l->company, error);
    if (status == KILN_OK) {
        choose_scale(l);
        status = kiln_lockstep_run(l, restored, finished, error);
    }
    if (status != KILN_OK)
        return status;
    kiln_radiosity_allgather_abandon(solution->allgather);
    kiln_radiosity_allgather_unlimit(solution->allgather);
    if (p->settings->probes)
        kiln_exchange_total_radiosity(&l->exchange, kiln_solution_step(solution));
    close_energy(l);
    status = kiln_company_end(&l->company, error);
    solution->report.received = kiln_radiosity_allgather_received(solution->allgather);
    solution->report.whole = kiln_radiosity_allgather_whole(solution->allgather);
    return status;
}

int kiln_integrate(struct kiln_solution **solution, const struct kiln_integrate_params *params,
                   struct kiln_error *error)
{
    struct kiln_lockstep l = {.params = params};
    struct kiln_solution *s = NULL;
    int status = kiln_allocate(&s, 1, sizeof *s, "the solution", error);
    if (status == KILN_OK) {
        s->report.roles = kiln_roles(params->settings);
        status = kiln_lockstep_create(&l, params, s, error);
    }
    status = kiln_agree(params->communicator, status, error);
    if (status == KILN_OK)
        status = integrate(&l, error);
    if (status != KILN_OK && params->beside != NULL)
        params->beside->stop(params->beside->context);
    if (s != NULL && s->node_data != NULL)
        kiln_node_data_end(s->node_data);
    kiln_lockstep_release(&l);
    *solution = s;
    if (status != KILN_OK)
        kiln_solution_destroy(solution);
    return status;
}

int kiln_integrate_save(struct kiln_solution *solution, const struct kiln_integrate_params *params,
                        const struct kiln_array_range *more, size_t count, struct kiln_error *error)
{
    return kiln_save_solution(solution, params, more, count, error);
}
