/* Parsing of option values: defaults, job file and command line follow the same strict rules. */
#include <ctype.h>
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/job/gone.h"
#include "coordinator/job/job_private.h"
#include "coordinator/job/options.h"

static void *field(struct kiln_job *job, const struct kiln_option *option) { return (char *)job + option->offset; }

/* Parses a decimal number: digits, signs, one point and an exponent. Other forms that strtod accepts are refused (nan,
 * inf, hexadecimal numbers, leading blanks). */
static bool decimal(const char *text, double *value)
{
    if (text[0] == '\0' || text[strspn(text, "0123456789+-.eE")] != '\0')
        return false;
    char *end = NULL;
    *value = strtod(text, &end);
    return *end == '\0' && end != text && isfinite(*value);
}

static bool whole(const char *text, bool *negative, uint64_t *magnitude)
{
    *negative = text[0] == '-';
    const char *digits = text + (text[0] == '-' || text[0] == '+');
    if (digits[0] == '\0')
        return false;
    if (digits[strspn(digits, "0123456789")] == '\0') {
        errno = 0;
        *magnitude = strtoull(digits, NULL, 10);
        return errno == 0;
    }
    double value; /* whole numbers may be given as 1e6 */
    if (!isdigit((unsigned char)digits[0]) || !decimal(digits, &value) || value != floor(value) || value > 0x1p53)
        return false;
    *magnitude = (uint64_t)value;
    return true;
}

static int refuse_number(const struct kiln_option *option, const char *text, const char *where, int status, bool number,
                         struct kiln_error *error)
{
    char word[160] = "", range[96];
    for (const struct kiln_option_word *w = option->words; w != NULL && w->word != NULL; w++) {
        const size_t used = strlen(word);
        (void)snprintf(word + used, sizeof word - used, ", %s%s", w[1].word == NULL ? "or " : "", w->word);
    }
    if (option->word != NULL)
        (void)snprintf(word, sizeof word, ", %s%s%s%s", option->may_be_infinite ? "inf, or " : "or ", option->word,
                       option->other_word != NULL ? ", or " : "", option->other_word != NULL ? option->other_word : "");
    if (option->maximum >= 0x1p64)
        (void)snprintf(range, sizeof range, "from %.15g to 18446744073709551615", option->minimum);
    else
        (void)snprintf(range, sizeof range, "from %.15g to %.15g", option->minimum, option->maximum);
    const char *kind = option->kind == KILN_OPTION_DOUBLE ? "a number" : "a whole number";
    if (number)
        return kiln_fail(error, status, "%s: %.200s is out of range; it must be %s %s%s", where, text, kind, range,
                         word);
    return kiln_fail(error, status, "%s: '%.200s' is not %s; it must be one %s%s", where, text, kind, range, word);
}

/* The number for which a word of a list stands. */
static bool word_number(const struct kiln_option *option, const char *text, double *value)
{
    for (const struct kiln_option_word *w = option->words; w != NULL && w->word != NULL; w++)
        if (strcmp(text, w->word) == 0) {
            *value = w->value;
            return true;
        }
    return false;
}

static int set_number(struct kiln_job *job, const struct kiln_option *option, const char *text, const char *where,
                      int status, struct kiln_error *error)
{
    bool negative = false;
    uint64_t magnitude = 0;
    double value = 0;
    if (word_number(option, text, &value)) {
        *(double *)field(job, option) = value;
        return KILN_OK;
    }
    if (option->word != NULL && strcmp(text, option->word) == 0) {
        value = option->word_value;
        negative = value < 0;
        magnitude = (uint64_t)fabs(value);
    } else if (option->other_word != NULL && strcmp(text, option->other_word) == 0) {
        value = option->other_value; /* of KILN_OPTION_DOUBLE */
    } else if (option->may_be_infinite && strcmp(text, "inf") == 0) {
        value = INFINITY;
    } else {
        if (option->kind == KILN_OPTION_DOUBLE ? !decimal(text, &value) : !whole(text, &negative, &magnitude)) {
            double any;
            return refuse_number(option, text, where, status,
                                 option->kind != KILN_OPTION_DOUBLE && decimal(text, &any) && any == floor(any), error);
        }
        if (option->kind != KILN_OPTION_DOUBLE)
            value = negative ? -(double)magnitude : (double)magnitude;
        if (value < option->minimum || value > option->maximum)
            return refuse_number(option, text, where, status, true, error);
    }
    switch (option->kind) {
    case KILN_OPTION_UINT32:
        *(uint32_t *)field(job, option) = (uint32_t)magnitude;
        break;
    case KILN_OPTION_UINT64:
        *(uint64_t *)field(job, option) = magnitude;
        break;
    case KILN_OPTION_INT64:
        *(int64_t *)field(job, option) = negative ? -(int64_t)magnitude : (int64_t)magnitude;
        break;
    default:
        *(double *)field(job, option) = value;
        break;
    }
    return KILN_OK;
}

static int set_flag(struct kiln_job *job, const struct kiln_option *option, const char *text, const char *where,
                    int status, struct kiln_error *error)
{
    if (strcmp(text, "true") != 0 && strcmp(text, "false") != 0)
        return kiln_fail(error, status, "%s: '%.200s' is neither true nor false", where, text);
    *(bool *)field(job, option) = text[0] == 't';
    return KILN_OK;
}

bool kiln_option_percentage(const char *text, double *percent)
{
    char number[32];
    const size_t length = strlen(text);
    if (length < 2 || length >= sizeof number || text[length - 1] != '%')
        return false;
    memcpy(number, text, length - 1);
    number[length - 1] = '\0';
    return decimal(number, percent);
}

static int set_choice(struct kiln_job *job, const struct kiln_option *option, const char *text, const char *where,
                      int status, struct kiln_error *error)
{
    char list[256] = "";
    for (int i = 0; option->choices[i] != NULL; i++) {
        if (strcmp(text, option->choices[i]) == 0) {
            if (option->kind == KILN_OPTION_CHOICE_FLAG) {
                *(bool *)field(job, option) = i == 1;
                return KILN_OK;
            }
            if (option->kind == KILN_OPTION_CHOICE_ENUM) {
                memcpy(field(job, option), &i, sizeof i);
                return KILN_OK;
            }
            return kiln_job_keep(job, text, strlen(text), field(job, option), error);
        }
        const size_t used = strlen(list);
        (void)snprintf(list + used, sizeof list - used, "%s%s", i == 0 ? "" : ", ", option->choices[i]);
    }
    double percent;
    if (option->percentage && kiln_option_percentage(text, &percent))
        return percent >= option->minimum && percent <= option->maximum
                   ? kiln_job_keep(job, text, strlen(text), field(job, option), error)
                   : kiln_fail(error, status, "%s: %.200s is out of range; it must be from %g%% to %g%%", where, text,
                               option->minimum, option->maximum);
    const struct kiln_gone_option *gone = kiln_gone_value_find(option->name, text);
    if (gone != NULL)
        return kiln_fail(error, status, "%s: '%s' is no more since kiln %s: %s", where, text, gone->since,
                         gone->instead);
    return kiln_fail(error, option->refusal != 0 ? option->refusal : status,
                     option->refusal != 0 ? "%s: this build has no %s '%.200s'; it has: %s%s"
                                          : "%s: there is no %s '%.200s'; there is: %s%s",
                     where, option->name, text, list, option->percentage ? ", or an error such as 5%" : "");
}

/* Parses numbers separated by commas. */
static bool numbers(const char *text, double *values, int count)
{
    char part[64];
    for (int i = 0; i < count; i++) {
        const size_t length = strcspn(text, ",");
        if (length >= sizeof part)
            return false;
        memcpy(part, text, length);
        part[length] = '\0';
        if (!decimal(part, &values[i]) || text[length] != (i < count - 1 ? ',' : '\0'))
            return false;
        text += length + 1;
    }
    return true;
}

static bool triple(const char *text, double values[3]) { return numbers(text, values, 3); }

bool kiln_option_box(const char *text, double box[6]) { return numbers(text, box, 6); }

static int set_box(struct kiln_job *job, const struct kiln_option *option, const char *text, const char *where,
                   int status, struct kiln_error *error)
{
    double box[6];
    if (!kiln_option_box(text, box))
        return kiln_fail(error, status,
                         "%s: '%.200s' is not a box; it must be six numbers separated by commas, the least corner and "
                         "the greatest, such as -2,0,-2,2,3,2",
                         where, text);
    for (int i = 0; i < 6; i++)
        if (fabs(box[i]) > KILN_PLACE_MOST)
            return kiln_fail(error, status, "%s: %g is out of range; each number must be from %g to %g", where, box[i],
                             -KILN_PLACE_MOST, KILN_PLACE_MOST);
    for (int axis = 0; axis < 3; axis++)
        if (!(box[axis] < box[axis + 3]))
            return kiln_fail(error, status,
                             "%s: the box goes from %g to %g along %c; the first corner must have the lesser number",
                             where, box[axis], box[axis + 3], "xyz"[axis]);
    return kiln_job_keep(job, text, strlen(text), field(job, option), error);
}

static int set_point(struct kiln_job *job, const struct kiln_option *option, const char *text, const char *where,
                     int status, struct kiln_error *error)
{
    double place[3];
    if (!triple(text, place))
        return kiln_fail(error, status,
                         "%s: '%.200s' is not a point; it must be three numbers separated by commas, such as 0,1.5,3",
                         where, text);
    for (int axis = 0; axis < 3; axis++)
        if (fabs(place[axis]) > KILN_PLACE_MOST)
            return kiln_fail(error, status, "%s: %g is out of range; each of X,Y,Z must be a number from %g to %g",
                             where, place[axis], -KILN_PLACE_MOST, KILN_PLACE_MOST);
    return kiln_job_keep(job, text, strlen(text), field(job, option), error);
}

static int set_environment(struct kiln_job *job, const struct kiln_option *option, const char *text, const char *where,
                           int status, const char *folder, struct kiln_error *error)
{
    double radiance[3];
    const bool colour = triple(text, radiance);
    for (int c = 0; colour && c < 3; c++)
        if (radiance[c] < 0.0 || radiance[c] > KILN_LIGHT_MOST)
            return kiln_fail(error, status,
                             "%s: a radiance of %g is out of range; each of R,G,B must be a number from 0 to %g", where,
                             radiance[c], KILN_LIGHT_MOST);
    if (colour || strcmp(text, "none") == 0)
        return kiln_job_keep(job, text, strlen(text), field(job, option), error);
    const char *dot = strrchr(text, '.');
    if (dot == NULL || (strcasecmp(dot, ".hdr") != 0 && strcasecmp(dot, ".exr") != 0))
        return kiln_fail(
            error, status,
            "%s: '%.200s' is neither none, nor a radiance R,G,B (three numbers from 0 up), nor an image (.hdr or .exr)",
            where, text);
    return kiln_job_keep_path(job, text, folder, field(job, option), error);
}

/* Appends a line to the lines given before. */
static int add_line(struct kiln_job *job, const struct kiln_option *option, const char *text, const char *where,
                    int status, struct kiln_error *error)
{
    char **lines = field(job, option), *made = NULL;
    const char *before = *lines != NULL ? *lines : "";
    if (strchr(text, '\n') != NULL)
        return kiln_fail(error, status, "%s: '%.200s' has a line break", where, text);
    const size_t room = strlen(before) + strlen(text) + 2;
    const int kept = kiln_job_keep_room(job, room, (void **)&made, error);
    if (kept != KILN_OK)
        return kept;
    (void)snprintf(made, room, "%s%s%s", before, before[0] != '\0' ? "\n" : "", text);
    *lines = made;
    return KILN_OK;
}

int kiln_option_set(struct kiln_job *job, const struct kiln_option *option, const char *text, const char *where,
                    int status, const char *folder, struct kiln_error *error)
{
    switch (option->kind) {
    case KILN_OPTION_FLAG:
        return set_flag(job, option, text, where, status, error);
    case KILN_OPTION_CHOICE:
    case KILN_OPTION_CHOICE_ENUM:
    case KILN_OPTION_CHOICE_FLAG:
        return set_choice(job, option, text, where, status, error);
    case KILN_OPTION_UINT32:
    case KILN_OPTION_UINT64:
    case KILN_OPTION_INT64:
    case KILN_OPTION_DOUBLE:
        return set_number(job, option, text, where, status, error);
    default:
        break;
    }
    if (text[0] == '\0')
        return kiln_fail(error, status, "%s: is empty; it must be %s", where, option->value);
    const bool writes = strcmp(option->name, "output") == 0 || strcmp(option->name, "trace") == 0;
    if (writes && text[0] == '-') /* other programs would read the name as an option */
        return kiln_fail(error, status,
                         "%s: '%.200s' begins with '-': write './%.200s' if that is what the file is to be called",
                         where, text, text);
    if (option->kind == KILN_OPTION_ENVIRONMENT)
        return set_environment(job, option, text, where, status, folder, error);
    if (option->kind == KILN_OPTION_POINT)
        return set_point(job, option, text, where, status, error);
    if (option->kind == KILN_OPTION_BOX)
        return set_box(job, option, text, where, status, error);
    if (option->kind == KILN_OPTION_LINES)
        return add_line(job, option, text, where, status, error);
    if (option->kind == KILN_OPTION_RULES)
        return kiln_job_rules_parse(text, where, status, job, field(job, option), error);
    const bool is_path = option->kind == KILN_OPTION_PATH && (option->word == NULL || strcmp(text, option->word) != 0);
    return kiln_job_keep_path(job, text, is_path ? folder : NULL, field(job, option), error);
}
