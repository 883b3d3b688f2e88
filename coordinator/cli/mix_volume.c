#include "coordinator/cli/mix_volume.h"

#include <string.h>

#include "coordinator/field/result.h"
#include "coordinator/field/units.h"
#include "coordinator/mpi/agree.h"
#include "coordinator/output/output.h"
#include "coordinator/output/read/rows.h"
#include "worker/base/memory.h"

#define NAME "volume.hdf"
#define POINT_DATA "/VTKHDF/PointData/"
enum { SH = 27, LIGHT = SH + 18, OCCLUDERS = 3 * KILN_OCCLUDER_DIRECTIONS };

static const char *const axes[6] = {POINT_DATA "irradiance_posx", POINT_DATA "irradiance_negx",
                                    POINT_DATA "irradiance_posy", POINT_DATA "irradiance_negy",
                                    POINT_DATA "irradiance_posz", POINT_DATA "irradiance_negz"};

struct volume_mix {
    const struct kiln_mix_params *params;
    struct kiln_volume_result volume;
    struct kiln_probe_result *probes;
    struct kiln_probe_occluders *occluders;
    struct kiln_probe_place *places;
    double *sum; /* of each probe LIGHT components */
};

bool kiln_mix_has_volume(const struct kiln_results *results, const json_t *run)
{
    return json_object_get(run, "volume") != NULL && kiln_results_has(results, NAME);
}

static int damaged(const struct volume_mix *m, const char *what, struct kiln_error *error)
{
    return kiln_fail(error, KILN_BAD_INPUT, "%.300s: " NAME " has no %s for each of its probes; bake again",
                     m->params->bake, what);
}

/* The grid, as run.json has it. */
static int find_grid(struct volume_mix *m, const json_t *run, uint64_t *count, struct kiln_error *error)
{
    const json_t *volume = json_object_get(run, "volume");
    struct kiln_volume_result *v = &m->volume;
    *count = 1;
    for (size_t a = 0; a < 3; a++) {
        const json_int_t size = json_integer_value(json_array_get(json_object_get(volume, "size"), a));
        if (size <= 0 || size > 1 << 28)
            return damaged(m, "size", error);
        v->size[a] = (uint64_t)size;
        v->origin[a] = json_number_value(json_array_get(json_object_get(volume, "origin"), a));
        v->spacing[a] = json_number_value(json_array_get(json_object_get(volume, "spacing"), a));
        *count *= v->size[a];
        if (*count > 1 << 28)
            return damaged(m, "size", error);
    }
    return KILN_OK;
}

static int make_probes(struct volume_mix *m, uint64_t count, struct kiln_error *error)
{
    int status;
    KILN_TRY(kiln_allocate(&m->probes, count, sizeof *m->probes, "the probes", error));
    KILN_TRY(kiln_allocate(&m->occluders, count, sizeof *m->occluders, "the probes", error));
    KILN_TRY(kiln_allocate(&m->places, count, sizeof *m->places, "the probes", error));
    KILN_TRY(kiln_allocate(&m->sum, count * LIGHT, sizeof *m->sum, "the probes", error));
end:
    m->volume.count = status == KILN_OK ? count : 0;
    m->volume.probes = m->probes;
    m->volume.occluders = m->occluders;
    m->volume.places = m->places;
    return status;
}

/* Reads a dataset: component c of probe p goes to to[p * stride + c], as a float. */
static int read_into(const struct volume_mix *m, const char *dataset, unsigned components, float *to, size_t stride,
                     struct kiln_error *error)
{
    struct kiln_image *image = NULL;
    int status = kiln_results_image(m->params->results, NAME, &dataset, 1, &image, error);
    for (unsigned c = 0; c < components && status == KILN_OK; c++) {
        const float *from = kiln_dataset_of(image, dataset, c);
        if (from == NULL || image->width != m->volume.count)
            status = damaged(m, dataset, error);
        for (uint64_t p = 0; p < m->volume.count && status == KILN_OK; p++)
            to[p * stride + c] = from[p];
    }
    kiln_image_destroy(&image);
    return status;
}

/* Reads the data of probes that depend on no light. */
static int read_rest(struct volume_mix *m, struct kiln_error *error)
{
    const size_t stride = sizeof *m->probes / sizeof(float), place = sizeof *m->places / sizeof(float);
    float *states = NULL;
    int status;
    KILN_TRY(kiln_allocate(&states, m->volume.count, sizeof *states, "the probes", error));
    KILN_TRY(read_into(m, POINT_DATA "validity", 1, &m->probes[0].back_share, stride, error));
    KILN_TRY(read_into(m, POINT_DATA "mean_distance", 1, &m->probes[0].mean_distance, stride, error));
    KILN_TRY(read_into(m, POINT_DATA "offset", 3, m->places[0].offset, place, error));
    KILN_TRY(read_into(m, POINT_DATA "state", 1, states, 1, error));
    KILN_TRY(read_into(m, POINT_DATA "occluders", OCCLUDERS, m->occluders[0].planes[0], OCCLUDERS, error));
    for (uint64_t p = 0; p < m->volume.count; p++) {
        m->probes[p].back_share = 1.0f - m->probes[p].back_share;
        m->places[p].state = states[p] >= 0.0f && states[p] < KILN_PROBE_STATES ? (uint32_t)states[p] : 0;
    }
end:
    kiln_free(&states);
    return status;
}

/* Adds `factor` times light to the sums. */
static void add(struct volume_mix *m, const float *light, const double factor[3])
{
    for (uint64_t i = 0; i < m->volume.count * LIGHT; i++)
        m->sum[i] += factor[i % 3] * (double)light[i];
}

static int mix_light(struct volume_mix *m, struct kiln_error *error)
{
    const struct kiln_mix_factors *f = m->params->factors;
    float *light = NULL;
    int status;
    KILN_TRY(kiln_allocate(&light, m->volume.count * LIGHT, sizeof *light, "the probes", error));
    KILN_TRY(read_into(m, POINT_DATA "irradiance_sh", SH, light, LIGHT, error));
    for (size_t a = 0; a < 6; a++)
        KILN_TRY(read_into(m, axes[a], 3, light + SH + 3 * a, LIGHT, error));
    add(m, light, f->least);
    for (size_t g = 0; g < f->count; g++) {
        const double more[3] = {f->of[g][0] - f->least[0], f->of[g][1] - f->least[1], f->of[g][2] - f->least[2]};
        char dataset[KILN_CHANNEL_NAME_SIZE];
        if (!(more[0] > 0.0 || more[1] > 0.0 || more[2] > 0.0))
            continue;
        (void)snprintf(dataset, sizeof dataset, "/groups/%s", f->names[g]);
        KILN_TRY(read_into(m, dataset, LIGHT, light, LIGHT, error));
        add(m, light, more);
    }
    for (uint64_t i = 0; i < m->volume.count * LIGHT; i++) {
        struct kiln_probe_result *p = &m->probes[i / LIGHT];
        const uint64_t c = i % LIGHT;
        *(c < SH ? &p->radiance[c / 3][c % 3] : &p->irradiance_axes[(c - SH) / 3][c % 3]) = (float)m->sum[i];
    }
end:
    kiln_free(&light);
    return status;
}

int kiln_mix_volume(const struct kiln_mix_params *params, const json_t *run, bool has, MPI_Comm communicator,
                    struct kiln_error *error)
{
    struct volume_mix m = {.params = params, .volume = {.of_irradiance = true}};
    const struct kiln_units *units =
        kiln_units_named(json_string_value(json_object_get(json_object_get(run, "units"), "kind")));
    const struct kiln_bake_result result = {.units = units, .communicator = communicator};
    const struct kiln_output_params output = {.directory = params->directory};
    uint64_t count = 0;
    int rank;
    if (!has)
        return KILN_OK;
    (void)MPI_Comm_rank(communicator, &rank);
    int status = find_grid(&m, run, &count, error);
    m.volume.first = rank == 0 ? 0 : count;
    KILN_TRY(status);
    if (rank == 0)
        KILN_TRY(make_probes(&m, count, error));
    if (rank == 0)
        KILN_TRY(read_rest(&m, error));
    if (rank == 0)
        KILN_TRY(mix_light(&m, error));
end:
    status = kiln_agree(communicator, status, error);
    if (status == KILN_OK)
        status = kiln_write_volume(&result, &m.volume, &output, error);
    kiln_free(&m.probes);
    kiln_free(&m.occluders);
    kiln_free(&m.places);
    kiln_free(&m.sum);
    return status;
}
