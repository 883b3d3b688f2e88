/* The manual page. */
#include <string.h>

#include "coordinator/cli/help_text.h"
#include "worker/base/status.h"

/* Prints text with roff's special characters escaped. */
static void put(FILE *stream, const char *text)
{
    if (text[0] == '.' || text[0] == '\'')
        (void)fputs("\\&", stream);
    for (; *text != '\0'; text++)
        switch (*text) {
        case '\\':
            (void)fputs("\\e", stream);
            break;
        case '-':
            (void)fputs("\\-", stream);
            break;
        case '\'':
            (void)fputs("\\(aq", stream);
            break;
        case '`':
            (void)fputs("\\(ga", stream);
            break;
        case '^':
            (void)fputs("\\(ha", stream);
            break;
        case '~':
            (void)fputs("\\(ti", stream);
            break;
        default:
            (void)fputc(*text, stream);
            break;
        }
}

static void line(FILE *stream, const char *text)
{
    put(stream, text);
    (void)fputc('\n', stream);
}

static void print_commands(FILE *stream)
{
    (void)fputs(".SH COMMANDS\n", stream);
    for (size_t i = 0; i < kiln_command_count; i++) {
        const struct kiln_command *command = &kiln_commands[i];
        (void)fprintf(stream, ".TP\n.BI \"kiln %s \" \"", command->name);
        put(stream, command->arguments);
        (void)fputs("\"\n", stream);
        line(stream, command->summary);
        (void)fputs(".RS\n.PP\n.EX\n", stream);
        for (size_t e = 0; command->examples[e] != NULL; e++)
            line(stream, command->examples[e]);
        (void)fputs(".EE\n.RE\n", stream);
    }
}

/* Prints the commands that have the option, as in "bake, plan"; nothing if all have it. */
static void print_owners(FILE *stream, const struct kiln_option *option)
{
    const char *separator = "(";
    if (option->commands == KILN_FOR_ALL)
        return;
    for (size_t i = 0; i < kiln_command_count; i++)
        if ((kiln_commands[i].bit & option->commands) != 0) {
            (void)fprintf(stream, "%s%s", separator, kiln_commands[i].name);
            separator = ", ";
        }
    (void)fputs(")\n", stream);
}

/* The meaning of --output for each command. */
static void print_outputs(FILE *stream)
{
    for (size_t i = 0; i < kiln_command_count; i++)
        if (kiln_commands[i].output != NULL) {
            (void)fprintf(stream, ".br\n.B %s:\n", kiln_commands[i].name);
            line(stream, kiln_commands[i].output);
        }
}

static void print_option(FILE *stream, const struct kiln_option *option)
{
    char text[KILN_HELP_HEAD], sentence[KILN_HELP_SENTENCE];
    kiln_help_head(option, text);
    kiln_help_sentence(option, NULL, sentence);
    (void)fputs(".TP\n.B ", stream);
    line(stream, text);
    line(stream, sentence);
    if (strcmp(option->name, "output") == 0)
        print_outputs(stream);
    else
        print_owners(stream, option);
}

static void print_options(FILE *stream)
{
    const char *group = NULL;
    (void)fputs(".SH OPTIONS\nBehind each option stand the commands that have it.\n", stream);
    for (size_t i = 0; i < kiln_option_count; i++) {
        if (kiln_options[i].second_of != NULL)
            continue;
        if (group == NULL || strcmp(group, kiln_options[i].group) != 0)
            (void)fprintf(stream, ".SS %s\n", kiln_options[i].group);
        group = kiln_options[i].group;
        print_option(stream, &kiln_options[i]);
    }
    (void)fprintf(stream,
                  ".SS What \\-\\-quality sets\nAn error that 95 %% of the texels stay below, or sample counts "
                  "where an option gives some or excludes an error.\n.EX\n%-12s%7s%9s%9s%10s%8s\n",
                  "", "error", "direct", "bounce", "indirect", "probe");
    for (size_t i = 0; i < kiln_quality_count; i++)
        (void)fprintf(stream, "%-12s%5g %%%9u%9u%10u%8u\n", kiln_qualities[i].name, kiln_qualities[i].error,
                      kiln_qualities[i].samples_direct, kiln_qualities[i].samples_bounce,
                      kiln_qualities[i].samples_indirect, kiln_qualities[i].samples_probe);
    (void)fputs(".EE\n", stream);
}

static void print_statuses(FILE *stream)
{
    static const struct {
        int status;
        const char *meaning;
    } rows[] = {{KILN_OK, "success"},
                {KILN_USAGE, "wrong command line"},
                {KILN_BAD_INPUT, "the scene or the job is broken"},
                {KILN_NO_INPUT, "input is missing"},
                {KILN_NO_DEVICE, "there is no such device, or it was lost"},
                {KILN_BUG, "a bug in kiln"},
                {KILN_SYSTEM, "operating system or memory"},
                {KILN_CANNOT_CREATE, "output cannot be created"},
                {KILN_IO, "input/output error"},
                {KILN_STOPPED, "stopped on request, with a checkpoint: run the same command again"},
                {KILN_RANK_LOST, "a rank or node was lost: run the same command again"},
                {KILN_PERMISSION, "permission denied"},
                {KILN_SITE, "the set-up of the site is wrong"}};
    (void)fputs(".SH EXIT STATUS\n", stream);
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++)
        (void)fprintf(stream, ".TP\n.B %d\n%s\n", rows[i].status, rows[i].meaning);
}

void kiln_man_print(FILE *stream)
{
    (void)fputs(".TH KILN 1 \"\" \"kiln " KILN_VERSION "\" \"User Commands\"\n"
                ".SH NAME\nkiln \\- bake the light of a static scene into lightmaps\n"
                ".SH SYNOPSIS\n.B kiln\n.I COMMAND ARGUMENTS\n[\\fIoptions\\fR]\n"
                ".SH DESCRIPTION\n"
                "kiln takes a static scene (glTF or OBJ), computes its global illumination, and writes a lightmap for\n"
                "each object, the scene with the lightmaps\\(aq coordinates and links, and an irradiance volume.\n"
                "The same bake gives the same bits on any number of threads and ranks.\n"
                ".PP\n"
                ".B kiln COMMAND \\-\\-help\nshows the options that most need,\n"
                ".B kiln COMMAND \\-\\-help all\nall of them.\n"
                ".B kiln \\-\\-completion bash\nprints a script that completes commands, options and values.\n",
                stream);
    print_commands(stream);
    print_options(stream);
    (void)fputs(
        ".SH JOB FILES\n"
        "All options can stand in a YAML file, under the same names without the dashes, and the scene under\n"
        ".BR scene ,\n"
        "or, of a scene of many files, a list under\n"
        ".BR parts :\n"
        "each is {name: house, file: house.glb, at: {translation: [10, 0, 0]}}; without\n"
        ".B at\n"
        "it stands as in its file, and a list there places it often.\n"
        "Paths are relative to the file. Later wins: defaults, \\-\\-quality, the job file, the command line.\n",
        stream);
    print_statuses(stream);
}
