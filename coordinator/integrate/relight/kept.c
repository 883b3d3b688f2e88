#include "coordinator/integrate/companion.h"
#include "coordinator/integrate/relight/transport.h"
#include "coordinator/mpi/agree.h"
#include "worker/base/memory.h"

/* Kept transport: hits of a step's rays are written to files, or read from them (transport.h). A file that a rank
 * cannot open or write ends the step on all ranks. */

struct kept {
    const struct kiln_integrate_params *params;
    bool is_open; /* a step's files are */
};

static bool kept_wanted(const struct kiln_integrate_params *params) { return params->transport != NULL; }

static int create(void **self, const struct kiln_companion_site *site, struct kiln_error *error)
{
    struct kept *k = NULL;
    const int status = kiln_allocate(&k, 1, sizeof *k, "transport that is kept", error);
    if (status == KILN_OK)
        k->params = site->params;
    *self = k;
    return status;
}

/* Ends an open step, so that data of a failed or stopped one is on disk. */
static void destroy(void **self)
{
    struct kept *k = *self;
    struct kiln_error ignored = {{0}};
    if (k != NULL && k->is_open)
        (void)kiln_transport_end(k->params->transport, k->params->backend, &ignored);
    kiln_free(self);
}

static int before_step(void *self, const struct kiln_companion_site *site, struct kiln_error *error)
{
    struct kept *k = self;
    const struct kiln_integrate_params *p = k->params;
    k->is_open = true;
    return kiln_agree(p->communicator,
                      kiln_transport_begin(p->transport, p->backend, &kiln_solution_step(site->solution)->step, error),
                      error);
}

static int complete(void *self, const struct kiln_companion_site *site, struct kiln_error *error)
{
    struct kept *k = self;
    const struct kiln_integrate_params *p = k->params;
    (void)site;
    k->is_open = false;
    return kiln_agree(p->communicator, kiln_transport_end(p->transport, p->backend, error), error);
}

static uint64_t files(const struct kiln_companion_kept *kept, const struct kiln_step *step)
{
    const bool keeps = kept->job->light.keep == KILN_KEEP_ROWS && step != NULL && kiln_transport_keeps(step);
    return keeps ? kiln_transport_bytes(kept->points, step->samples, kept->goes_on) : 0;
}

static const char *const no_identity[] = {"keep-transport", NULL};

const struct kiln_companion kiln_companion_kept = {.name = "kept",
                                                   .whole_batches = true,
                                                   .no_identity = no_identity,
                                                   .wanted = kept_wanted,
                                                   .create = create,
                                                   .destroy = destroy,
                                                   .before_step = before_step,
                                                   .complete = complete,
                                                   .files = files};
