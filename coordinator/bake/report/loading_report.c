#include "coordinator/bake/report/loading_report.h"

/* `shift`: from the monotonic clock to MPI_Wtime(). */
static void trace(const struct kiln_phases *phases, const char *name, const struct kiln_aside *aside, double shift,
                  int64_t count)
{
    if (aside->count > 0)
        kiln_trace_add(phases->trace, KILN_TRACE_LOADING, name, aside->begin + shift, aside->end + shift, count);
}

static json_t *slowest_json(const struct kiln_made_kernel *slowest)
{
    json_t *all = json_array();
    for (size_t i = 0; i < KILN_MADE_KERNELS && slowest[i].name != NULL; i++) {
        json_t *constants = json_array();
        for (uint32_t c = 0; c < slowest[i].constant_count; c++)
            json_array_append_new(constants, json_integer(slowest[i].constants[c]));
        json_array_append_new(all, json_pack("{s:s, s:o, s:f}", "name", slowest[i].name, "constants", constants,
                                             "seconds", slowest[i].seconds));
    }
    return all;
}

json_t *kiln_loading_report(const struct kiln_prepared *p, const struct kiln_phases *phases)
{
    struct kiln_backend_info info;
    const double shift = MPI_Wtime() - kiln_clock_seconds();
    kiln_backend_info(p->backend, &info);
    const struct kiln_aside *device = &info.starting, *kernels = &info.making;
    trace(phases, "start of the device", device, shift, -1);
    trace(phases, "BVH", &p->built, shift, -1);
    trace(phases, "kernels", kernels, shift, (int64_t)kernels->count);
    double s[7] = {p->first_pass - phases->begin,
                   device->end - device->begin,
                   device->waited,
                   kernels->end - kernels->begin,
                   kernels->waited,
                   p->built.end - p->built.begin,
                   p->built.waited};
    uint64_t count = kernels->count;
    (void)MPI_Reduce(p->rank == 0 ? MPI_IN_PLACE : s, s, 7, MPI_DOUBLE, MPI_MAX, 0, p->communicator);
    (void)MPI_Reduce(p->rank == 0 ? MPI_IN_PLACE : &count, &count, 1, MPI_UINT64_T, MPI_SUM, 0, p->communicator);
    return p->rank != 0 ? NULL
                        : json_pack("{s:f, s:{s:f, s:f}, s:{s:f, s:f}, s:{s:I, s:f, s:f, s:o}}", "first_pass_after",
                                    s[0], "device", "seconds", s[1], "waited_seconds", s[2], "bvh", "seconds", s[5],
                                    "waited_seconds", s[6], "kernels", "count", (json_int_t)count, "seconds", s[3],
                                    "waited_seconds", s[4], "slowest", slowest_json(info.slowest));
}
