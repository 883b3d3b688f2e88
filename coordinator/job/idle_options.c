#include "coordinator/job/conditions.h"

#include <string.h>

#include "coordinator/job/options.h"

static bool is(const char *text, const char *wanted)
{
    return text != NULL && wanted != NULL && strcmp(text, wanted) == 0;
}

static const struct kiln_command *command_of(const struct kiln_job *job) { return kiln_command_find(job->command); }

bool kiln_option_counts(const struct kiln_job *job, const struct kiln_option *option)
{
    /* a bench chooses the settings of the bakes and views that it runs; these report options without effect
     * themselves */
    const bool child = command_of(job)->bit == KILN_FOR_BENCH && (option->commands & ~(uint32_t)KILN_FOR_BENCH) != 0;
    return option->when == NULL || child || option->when->holds(job);
}

/* Whether the value switches off what the option is about. */
static bool switches_off(const struct kiln_job *job, const struct kiln_option *option)
{
    char room[KILN_OPTION_TEXT];
    const char *text = kiln_option_text(job, option, room);
    return is(text, "none") || is(text, "off") || is(text, "inf") ||
           ((is(text, "0") || is(text, "1")) && is(text, option->fallback));
}

void kiln_job_print_idle(const struct kiln_job *job, FILE *stream)
{
    for (size_t i = 0; i < kiln_option_count; i++) {
        const struct kiln_option *option = &kiln_options[i];
        if ((option->commands & command_of(job)->bit) == 0 || !kiln_job_given(job, option) ||
            kiln_option_counts(job, option) || switches_off(job, option))
            continue;
        if (!kiln_option_behind(job, option))
            (void)fprintf(stream, "kiln: note: --%s does not count here: %s\n", option->name, option->when->otherwise);
        else if (kiln_option_counts(job, kiln_option_find_for(option->second_of, option->commands)))
            (void)fprintf(stream, "kiln: note: of --%s what stands behind the colon does not count here: %s\n",
                          option->second_of, option->when->otherwise);
    }
}
