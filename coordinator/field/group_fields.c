#include "coordinator/field/group_fields.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

static const char first_name[] = "group0.direct";

/* Field table rows of one light group, and the texts that they point to. */
struct rows {
    struct kiln_field field[KILN_GROUP_FIELDS];
    const char *channels[2][3];
    char names[KILN_GROUP_FIELDS][24], channel[2][3][KILN_GROUP_NAME + 16], datasets[2][KILN_GROUP_NAME + 16];
};

static const struct kiln_field kinds[KILN_GROUP_FIELDS] = {
    [KILN_GROUP_DIRECT] = {.name = "direct",
                           .type = KILN_FIELD_FLOAT,
                           .components = 3,
                           .life = KILN_FIELD_RESULT,
                           .saved = KILN_FIELD_SAVED,
                           .low = -INFINITY, /* denoised */
                           .high = INFINITY,
                           .description = "of /groups, the part that comes straight from the group's lights",
                           .noisy = true},
    [KILN_GROUP_SUM] = {.name = "sum",
                        .type = KILN_FIELD_FLOAT,
                        .components = 3,
                        .life = KILN_FIELD_RESULT,
                        .saved = KILN_FIELD_SAVED,
                        .low = -INFINITY,
                        .high = INFINITY,
                        .description = "light of the lights of one group, direct and indirect, about the shading "
                                       "normal, linear RGB, as gathered",
                        .noisy = true},
    [KILN_GROUP_SOURCE] = {.name = "source",
                           .type = KILN_FIELD_RADIOSITY,
                           .components = 1,
                           .life = KILN_FIELD_RESULT,
                           .saved = KILN_FIELD_SAVED_IN_GATHER,
                           .low = -INFINITY,
                           .high = INFINITY},
    [KILN_GROUP_NEXT] = {.name = "next",
                         .type = KILN_FIELD_RADIOSITY,
                         .components = 1,
                         .life = KILN_FIELD_STEP,
                         .saved = KILN_FIELD_SAVED_IN_STEP,
                         .low = -INFINITY,
                         .high = INFINITY}};

/* Parts of channel and dataset names: what precedes the group's name, and what follows it before the colour. */
static const char channel_begin[] = "group.", direct_part[] = ".direct";
static const char *const folders[] = {[KILN_GROUP_DIRECT] = "/groups_direct/", [KILN_GROUP_SUM] = "/groups/"};

static void fill(struct rows *r, uint16_t group, const char *name)
{
    static const char colors[] = "RGB";
    for (int k = 0; k < KILN_GROUP_FIELDS; k++) {
        r->field[k] = kinds[k];
        (void)snprintf(r->names[k], sizeof r->names[k], "group%u.%s", group, kinds[k].name);
        r->field[k].name = r->names[k];
        r->field[k].domain = KILN_DOMAIN_POINT;
    }
    for (int k = 0; k <= KILN_GROUP_SUM; k++) {
        (void)snprintf(r->datasets[k], sizeof r->datasets[k], "%s%s", folders[k], name);
        r->field[k].dataset = r->datasets[k];
    }
    for (int k = 0; k <= KILN_GROUP_SUM; k++)
        for (int c = 0; c < 3; c++) {
            (void)snprintf(r->channel[k][c], sizeof r->channel[k][c], "%s%s%s.%c", channel_begin, name,
                           k == KILN_GROUP_DIRECT ? direct_part : "", colors[c]);
            r->channels[k][c] = r->channel[k][c];
        }
    r->field[KILN_GROUP_DIRECT].channels = r->channels[KILN_GROUP_DIRECT];
    r->field[KILN_GROUP_SUM].channels = r->channels[KILN_GROUP_SUM];
}

int kiln_group_fields_make(struct kiln_job *job, struct kiln_error *error)
{
    void *room = NULL;
    int status = kiln_job_keep_room(job, (job->scene.group_count + 1) * sizeof *job->scene.group_rows, &room, error);
    job->scene.group_rows = room;
    for (size_t g = 0; g < job->scene.group_count && status == KILN_OK; g++) {
        struct rows *r = NULL;
        status = kiln_job_keep_room(job, sizeof *r, (void **)&r, error);
        if (status != KILN_OK)
            return status;
        fill(r, (uint16_t)g, job->scene.group_names[g]);
        job->scene.group_rows[g] = r->field;
    }
    return status;
}

static bool begins_with(const char *text, const char *begin) { return strncmp(text, begin, strlen(begin)) == 0; }

const struct kiln_field *kiln_group_field_named(const char *name)
{
    for (int k = 0; k <= KILN_GROUP_SUM; k++)
        if (begins_with(name, folders[k]))
            return &kinds[k];
    if (!begins_with(name, channel_begin))
        return NULL;
    const size_t length = strlen(name), tail = sizeof direct_part - 1 + 2; /* ".direct.R" */
    const bool direct = length > tail && begins_with(name + length - tail, direct_part);
    return &kinds[direct ? KILN_GROUP_DIRECT : KILN_GROUP_SUM];
}

size_t kiln_group_fields_first(const struct kiln_field_set *set) { return kiln_field_set_find(set, first_name); }

void kiln_group_folder(size_t n, char folder[KILN_GROUP_FOLDER])
{
    (void)snprintf(folder, KILN_GROUP_FOLDER, "lightmaps/groups-%zu", n);
}
