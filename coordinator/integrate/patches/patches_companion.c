#include "coordinator/integrate/companion.h"
#include "coordinator/integrate/patches/link_file.h"
#include "coordinator/integrate/patches/patches.h"
#include "coordinator/integrate/patches/patches_report.h"
#include "coordinator/integrate/patches/senders.h"
#include "coordinator/integrate/relight/transport.h"

enum { LINKS = 1000 }; /* of a point, to begin with */

/* ---- patches ---- */

static bool patches_wanted(const struct kiln_integrate_params *params) { return params->settings->patches != NULL; }

static int create(void **self, const struct kiln_companion_site *site, struct kiln_error *error)
{
    const struct kiln_integrate_params *p = site->params;
    const struct kiln_patches_source source = {.communicator = p->communicator,
                                               .ranks = p->ranks,
                                               .surface = p->surface,
                                               .backend = p->backend,
                                               .settings = p->settings,
                                               .direct = site->plans ? NULL : &site->solution->direct,
                                               .own = site->plans ? NULL : &site->solution->own,
                                               .replayed = p->transport,
                                               .keeps_visibility = !site->plans};
    struct kiln_patches *patches = NULL;
    const int status = kiln_patches_create(&patches, &source, error);
    *self = patches;
    return status;
}

static void destroy(void **self)
{
    struct kiln_patches *patches = *self;
    kiln_patches_destroy(&patches);
    *self = NULL;
}

static bool makes(const struct kiln_pass *pass)
{
    return pass == &kiln_pass_patches || pass == &kiln_pass_links || pass == &kiln_pass_directions;
}

static int parameters(void *self, const uint64_t *radiosity, struct kiln_step *step, struct kiln_error *error)
{
    return kiln_patches_update(self, radiosity, step, &step->parameters, error);
}

static int complete(void *self, const struct kiln_companion_site *site, struct kiln_error *error)
{
    struct kiln_integrate_report *report = &site->solution->report;
    struct kiln_transport *transport = site->params->transport;
    const bool keeps = transport != NULL && kiln_solution_step(site->solution)->step.pass == &kiln_pass_links;
    const int status = keeps ? kiln_patches_keep(self, transport, error) : KILN_OK;
    report->visibility = kiln_patches_visibility(self);
    kiln_patches_links(self, &report->links, &report->link_bytes);
    return status;
}

/* Weight of a step's cost: pairs of patches count in addition to a point's samples. */
static double weight(const struct kiln_step *step)
{
    const struct kiln_patches_parameters *patches = step->parameters;
    if (step->pass == &kiln_pass_links)
        return step->samples / ((double)step->samples + LINKS);
    return step->pass == &kiln_pass_patches ? step->samples / ((double)step->samples + (double)patches->count) : 1.0;
}

/* Points send a part of what they reflect. */
static void close_energy(const struct kiln_companion_site *site, struct kiln_energy_closing *closing)
{
    closing->albedo_scale = site->params->settings->patches->albedo_scale;
}

static void demand(const struct kiln_companion_demand *d, struct kiln_companion_bytes *bytes)
{
    if (d->settings->patches == NULL)
        return;
    bytes->always += kiln_patches_bytes(d->settings->patches, (uint64_t)d->own, d->points, d->device);
    if (d->device)
        bytes->device += kiln_patches_device_bytes(d->settings->patches, (uint64_t)d->own, d->points);
}

static uint64_t files(const struct kiln_companion_kept *kept, const struct kiln_step *step)
{
    const bool keeps = kept->job->light.keep == KILN_KEEP_LINKS && step == NULL;
    return keeps ? kiln_link_file_bytes_expected(kept->points, kept->job->light.patches.link_error) : 0;
}

static const char *const identity[] = {"lights",     "undersample", "sampling-window", "subdivide",   "node-max",
                                       "keep-nodes", "clamp",       "albedo-scale",    "patches",     "link-error",
                                       "visibility", "voxels",      "order",           "unshot-left", "gather",
                                       "directions", NULL};
/* Pairs are kept as tracing finds them. */
static const char *const no_identity[] = {"visibility-cache", NULL};

const struct kiln_companion kiln_companion_patches = {
    .name = "patches",
    .identity = identity,
    .no_identity = no_identity,
    .identity_after = "method",
    .wanted = patches_wanted,
    .create = create,
    .destroy = destroy,
    .makes = makes,
    .parameters = parameters,
    .complete = complete,
    .weight = weight,
    .close = close_energy,
    .count = kiln_patches_count,
    .report = {[KILN_REPORT_SETTINGS] = kiln_patches_report_settings, [KILN_REPORT_RANKS] = kiln_patches_report_ranks},
    .files = files,
    .demand = demand};

/* ---- senders: only some of the patches send in a step ---- */

static bool senders_wanted(const struct kiln_integrate_params *params)
{
    return patches_wanted(params) && params->settings->patches->order == KILN_ORDER_UNSHOT;
}

static double share(const struct kiln_step *step)
{
    (void)step;
    return 1.0 / KILN_UNSHOT_ROUNDS;
}

const struct kiln_companion kiln_companion_senders = {
    .name = "senders", .by_step = true, .wanted = senders_wanted, .share = share};
