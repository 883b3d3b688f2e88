#include "coordinator/bench/stability.h"

#include <stdio.h>
#include <string.h>
#include <time.h>

#include "coordinator/files/json.h"

static bool is_named(const struct kiln_job *job, const struct kiln_row *row)
{
    for (size_t i = 1; i < job->argument_count; i++)
        if (strcmp(job->arguments[i], row->group) == 0)
            return true;
    return false;
}

static bool is_wanted(const struct kiln_job *job, const struct kiln_row *row)
{
    return job->argument_count > 1 ? is_named(job, row) : !row->by_name_only;
}

static int check_names(const struct kiln_job *job, struct kiln_error *error)
{
    for (size_t i = 1; i < job->argument_count; i++) {
        char names[400] = "";
        bool known = false;
        for (size_t r = 0; r < kiln_row_count; r++) {
            const size_t used = strlen(names);
            known = known || strcmp(kiln_rows[r].group, job->arguments[i]) == 0;
            if (r == 0 || strcmp(kiln_rows[r].group, kiln_rows[r - 1].group) != 0)
                (void)snprintf(names + used, sizeof names - used, "%s%s", r == 0 ? "" : ", ", kiln_rows[r].group);
        }
        if (!known)
            return kiln_fail(error, KILN_USAGE, "no rows are called '%.100s'; there are: %s", job->arguments[i], names);
    }
    return KILN_OK;
}

static double now(void)
{
    struct timespec time;
    (void)clock_gettime(CLOCK_MONOTONIC, &time);
    return (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
}

struct table {
    const struct kiln_job *job;
    json_t *rows; /* NULL: the table is printed row by row */
    size_t count, failed;
};

static void print_head(const struct table *table)
{
    if (table->rows == NULL)
        (void)printf("%-13s%-50s%-46s%-56s%s\n", "row", "what is tried", "expected", "measured", "holds");
}

static void add(struct table *table, const struct kiln_row *row, const struct kiln_row_found *found, double seconds)
{
    table->count++;
    table->failed += found->holds ? 0 : 1;
    if (table->rows == NULL) {
        (void)printf("%-13s%-50s%-46s%-56s%s\n", row->group, row->tried, row->expected, found->measured,
                     found->holds ? "yes" : "NO");
        (void)fflush(stdout);
        return;
    }
    (void)json_array_append_new(table->rows, json_pack("{s:s, s:s, s:s, s:f, s:o, s:b, s:f}", "row", row->group,
                                                       "tried", row->tried, "expected", row->expected, "tolerance",
                                                       row->tolerance, "measured", kiln_json_string(found->measured),
                                                       "holds", (int)found->holds, "seconds", seconds));
}

static int run_rows(struct table *table, struct kiln_trial *trial)
{
    int status = KILN_OK;
    for (size_t i = 0; i < kiln_row_count && status == KILN_OK; i++) {
        const struct kiln_row *row = &kiln_rows[i];
        struct kiln_row_found found = {0};
        if (!is_wanted(table->job, row))
            continue;
        const double begin = now();
        status = row->run(trial, row, &found);
        if (status == KILN_OK)
            add(table, row, &found, now() - begin);
    }
    return status;
}

static int conclude(struct table *table, struct kiln_job *job, struct kiln_error *error)
{
    int status = KILN_OK;
    if (table->rows != NULL) {
        job->answered = true;
        status = kiln_json_print(json_pack("{s:s, s:i, s:i, s:O}", "status", "done", "rows_tried", (int)table->count,
                                           "rows_that_do_not_hold", (int)table->failed, "rows", table->rows),
                                 error);
    } else {
        (void)printf("%zu rows, %zu of them do not hold\n", table->count, table->failed);
        (void)fflush(stdout);
    }
    if (status != KILN_OK || table->failed == 0)
        return status;
    return kiln_fail(error, KILN_BUG, "%zu of %zu rows of the table do not hold", table->failed, table->count);
}

int kiln_stability_bench(struct kiln_job *job, struct kiln_error *error)
{
    struct table table = {.job = job};
    struct kiln_trial trial;
    int status = check_names(job, error);
    if (status != KILN_OK)
        return status;
    status = kiln_trial_begin(&trial, job, error);
    if (status == KILN_OK && job->json && (table.rows = json_array()) == NULL)
        status = kiln_fail(error, KILN_SYSTEM, "out of memory for the table");
    if (status == KILN_OK) {
        print_head(&table);
        status = run_rows(&table, &trial);
    }
    kiln_trial_end(&trial);
    if (status == KILN_OK)
        status = conclude(&table, job, error);
    json_decref(table.rows);
    return status;
}
