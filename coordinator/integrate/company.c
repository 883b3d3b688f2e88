#include "coordinator/integrate/company.h"

#include <assert.h>

#include "coordinator/mpi/agree.h"

/* Whether companion i is there, and accompanies the step; NULL: any. */
static bool is_there(const struct kiln_company *c, size_t i, const struct kiln_step *step)
{
    return c->of[i].wanted && (step == NULL || kiln_companion_is_with(c->table, i, step));
}

/* The step under way. */
static const struct kiln_step *step_of(const struct kiln_company *c)
{
    return &kiln_solution_step(c->site.solution)->step;
}

static size_t count_of(const struct kiln_company *c)
{
    size_t count = 0;
    while (c != NULL && c->table != NULL && c->table[count] != NULL)
        count++;
    return count;
}

int kiln_company_create(struct kiln_company *c, const struct kiln_companion_site *site, struct kiln_error *error)
{
    int status = KILN_OK;
    *c = (struct kiln_company){.table = site->params->companions, .site = *site};
    const size_t count = count_of(c);
    assert(count <= KILN_COMPANY_MOST);
    for (size_t i = 0; i < count && status == KILN_OK; i++) {
        const struct kiln_companion *row = c->table[i];
        if (!row->wanted(site->params))
            continue;
        c->of[i].wanted = true;
        c->whole_batches = c->whole_batches || row->whole_batches;
        if (row->create != NULL)
            status = row->create(&c->of[i].self, &c->site, error);
    }
    return status;
}

void kiln_company_destroy(struct kiln_company *c)
{
    for (size_t i = count_of(c); i-- > 0;)
        if (c->of[i].wanted && c->table[i]->destroy != NULL)
            c->table[i]->destroy(&c->of[i].self);
    *c = (struct kiln_company){0};
}

/* Calls `function` of each companion that takes part in `step`, until one fails. */
#define ASK(c, step, function, ...)                                                                                    \
    int status = KILN_OK;                                                                                              \
    for (size_t i = 0, count = count_of(c); i < count && status == KILN_OK; i++)                                       \
        if (is_there(c, i, step) && (c)->table[i]->function != NULL)                                                   \
            status = (c)->table[i]->function(__VA_ARGS__);                                                             \
    return status

/* Collective. */
static int settle(struct kiln_company *c, struct kiln_error *error)
{
    ASK(c, NULL, settle, &c->of[i].self, &c->site, error);
}

int kiln_company_settle(struct kiln_company *c, struct kiln_error *error)
{
    const struct kiln_integrate_params *p = c->site.params;
    const int found = kiln_companions_find(c->table, p, c->site.solution->own, error),
              status = kiln_agree(p->communicator, found, error);
    return status == KILN_OK ? settle(c, error) : status;
}

int kiln_company_end(struct kiln_company *c, struct kiln_error *error)
{
    ASK(c, NULL, end, c->of[i].self, &c->site, error);
}

/* Collective. */
static int make_parameters(struct kiln_company *c, struct kiln_error *error)
{
    struct kiln_step *step = &kiln_solution_step(c->site.solution)->step;
    int status = KILN_OK;
    for (size_t i = 0, count = count_of(c); i < count && status == KILN_OK; i++)
        if (is_there(c, i, step) && c->table[i]->makes != NULL && c->table[i]->makes(step->pass))
            status = c->table[i]->parameters(c->of[i].self, c->site.solution->radiosity, step, error);
    return status;
}

/* Collective. */
static int prepare(struct kiln_company *c, struct kiln_error *error)
{
    ASK(c, step_of(c), before_step, c->of[i].self, &c->site, error);
}

int kiln_company_before_step(struct kiln_company *c, struct kiln_error *error)
{
    const int status = make_parameters(c, error);
    return status == KILN_OK ? prepare(c, error) : status;
}

int kiln_company_complete(struct kiln_company *c, struct kiln_error *error)
{
    ASK(c, step_of(c), complete, c->of[i].self, &c->site, error);
}

int kiln_company_after_step(struct kiln_company *c, double unit, struct kiln_error *error)
{
    ASK(c, step_of(c), after_step, c->of[i].self, &c->site, unit, error);
}

int kiln_company_before_move(struct kiln_company *c, const uint64_t *bounds, struct kiln_error *error)
{
    ASK(c, NULL, before_move, c->of[i].self, &c->site, bounds, error);
}

int kiln_company_after_move(struct kiln_company *c, struct kiln_error *error)
{
    ASK(c, NULL, after_move, c->of[i].self, &c->site, error);
}

int kiln_company_answer(struct kiln_company *c, const struct kiln_step *step, const struct kiln_batch *batch,
                        struct kiln_error *error)
{
    ASK(c, step, answer, c->of[i].self, batch, error);
}

void kiln_company_take(const struct kiln_company *c, const struct kiln_taking *taking,
                       const struct kiln_rank_data *data, const struct kiln_tile_run *tile_run, const void *results)
{
    for (size_t i = 0, count = count_of(c); i < count; i++)
        if (is_there(c, i, taking->step) && c->table[i]->take != NULL)
            c->table[i]->take(c->of[i].self, taking, data, tile_run, results);
}

double kiln_company_weight(const struct kiln_company *c, const struct kiln_step *step)
{
    double weight = 1.0;
    for (size_t i = 0, count = count_of(c); i < count; i++)
        if (is_there(c, i, step) && c->table[i]->weight != NULL)
            weight *= c->table[i]->weight(step);
    return weight;
}

bool kiln_company_has_light(const struct kiln_company *c)
{
    bool any = false;
    for (size_t i = 0, count = count_of(c); i < count; i++)
        any = any || (c->of[i].wanted && c->table[i]->each_light != NULL);
    return any;
}

void kiln_company_exchange(struct kiln_company *c, bool restored)
{
    for (size_t i = 0, count = count_of(c); i < count; i++)
        if (is_there(c, i, NULL) && c->table[i]->exchange != NULL)
            c->table[i]->exchange(c->of[i].self, restored);
}

void kiln_company_each_light(const struct kiln_company *c, void (*change)(const struct kiln_rank_data *own))
{
    for (size_t i = 0, count = count_of(c); i < count; i++)
        if (is_there(c, i, NULL) && c->table[i]->each_light != NULL)
            c->table[i]->each_light(c->of[i].self, change);
}

void kiln_company_extend(const struct kiln_company *c, struct kiln_own_point first, uint64_t count,
                         const float factor[3])
{
    for (size_t i = 0, all = count_of(c); i < all; i++)
        if (is_there(c, i, NULL) && c->table[i]->extend != NULL)
            c->table[i]->extend(c->of[i].self, first, count, factor);
}

void kiln_company_close(const struct kiln_company *c, struct kiln_energy_closing *closing)
{
    for (size_t i = 0, count = count_of(c); i < count; i++)
        if (is_there(c, i, NULL) && c->table[i]->close != NULL)
            c->table[i]->close(&c->site, closing);
}

size_t kiln_company_arrays(struct kiln_company *c, struct kiln_array_range *blocks)
{
    size_t filled = 0;
    for (size_t i = 0, count = count_of(c); i < count; i++)
        if (is_there(c, i, step_of(c)) && c->table[i]->blocks != NULL)
            filled += c->table[i]->blocks(c->of[i].self, blocks + filled);
    assert(filled <= KILN_COMPANY_ARRAYS);
    return filled;
}

uint64_t kiln_company_saved_bytes(const struct kiln_company *c, const struct kiln_step *step)
{
    uint64_t bytes = 0;
    for (size_t i = 0, count = count_of(c); i < count; i++)
        if (is_there(c, i, step) && c->table[i]->saved_bytes != NULL)
            bytes += c->table[i]->saved_bytes(c->site.params->settings);
    return bytes;
}
