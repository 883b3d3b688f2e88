#include <stdio.h>

#include "coordinator/job/options.h"

static const char *number_text(const struct kiln_option *option, double value, const char *format,
                               char room[KILN_OPTION_TEXT])
{
    if (option->word != NULL && value == option->word_value)
        return option->word;
    if (option->other_word != NULL && value == option->other_value)
        return option->other_word;
    (void)snprintf(room, KILN_OPTION_TEXT, format, value);
    return room;
}

const char *kiln_option_text(const struct kiln_job *job, const struct kiln_option *option, char room[KILN_OPTION_TEXT])
{
    const void *at = (const char *)job + option->offset;
    const char *text = NULL;
    switch (option->kind) {
    case KILN_OPTION_FLAG:
        return *(const bool *)at ? "on" : "off";
    case KILN_OPTION_CHOICE_FLAG:
        return option->choices[*(const bool *)at ? 1 : 0];
    case KILN_OPTION_CHOICE_ENUM:
        return option->choices[*(const int *)at];
    case KILN_OPTION_UINT32:
        return number_text(option, (double)*(const uint32_t *)at, "%.0f", room);
    case KILN_OPTION_INT64:
        return number_text(option, (double)*(const int64_t *)at, "%.0f", room);
    case KILN_OPTION_UINT64:
        if (option->word != NULL && (double)*(const uint64_t *)at == option->word_value)
            return option->word;
        (void)snprintf(room, KILN_OPTION_TEXT, "%llu", (unsigned long long)*(const uint64_t *)at);
        return room;
    case KILN_OPTION_DOUBLE:
        return number_text(option, *(const double *)at, "%.17g", room);
    case KILN_OPTION_STRING:
    case KILN_OPTION_LINES:
    case KILN_OPTION_PATH:
    case KILN_OPTION_ENVIRONMENT:
    case KILN_OPTION_POINT:
    case KILN_OPTION_BOX:
    case KILN_OPTION_RULES:
    case KILN_OPTION_CHOICE:
        text = *(char *const *)at;
        break;
    }
    return text != NULL ? text : "not given";
}

const char *kiln_option_argument(const struct kiln_job *job, const struct kiln_option *option,
                                 char room[KILN_OPTION_TEXT])
{
    char first[KILN_OPTION_TEXT], second[KILN_OPTION_TEXT];
    const struct kiln_option *other = kiln_option_second(option);
    if (other == NULL || !kiln_job_given(job, other))
        return kiln_option_text(job, option, room);
    const char *before = kiln_option_text(job, option, first), *behind = kiln_option_text(job, other, second);
    (void)snprintf(room, KILN_OPTION_TEXT, "%.31s:%.31s", before, behind);
    return room;
}
