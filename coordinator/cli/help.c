#include <string.h>

#include "coordinator/job/options.h"
#include "coordinator/view/show.h"

/* Formats an option with its values: "--bounces N|all", "--half", "--partition cells|objects". */
static void option_head(const struct kiln_option *option, char *text, size_t size)
{
    int used = snprintf(text, size, "--%s", option->name);
    const char *separator = " ";
    if (option->value != NULL) {
        used += snprintf(text + used, size - (size_t)used, " %s", option->value);
        separator = "|";
    }
    if (option->may_be_infinite)
        used += snprintf(text + used, size - (size_t)used, "|inf");
    if (option->word != NULL)
        used += snprintf(text + used, size - (size_t)used, "%s%s", separator, option->word);
    for (size_t i = 0; option->choices != NULL && option->choices[i] != NULL; i++) {
        used += snprintf(text + used, size - (size_t)used, "%s%s", separator, option->choices[i]);
        separator = "|";
    }
}

static void print_option(FILE *stream, const struct kiln_option *option)
{
    enum { COLUMN = 34 };
    char head[160];
    option_head(option, head, sizeof head);
    if (strlen(head) < COLUMN - 4)
        (void)fprintf(stream, "  %-*s", COLUMN - 2, head);
    else
        (void)fprintf(stream, "  %s\n%*s", head, COLUMN, "");
    const char *value = kiln_option_default(option);
    if (option->kind == KILN_OPTION_FLAG && strcmp(value, "on") == 0)
        (void)fprintf(stream, "%s (default on; --no-%s)\n", option->help, option->name);
    else if (value[0] != '\0')
        (void)fprintf(stream, "%s (default %s)\n", option->help, value);
    else
        (void)fprintf(stream, "%s\n", option->help);
}

static void print_qualities(FILE *stream)
{
    (void)fprintf(stream, "\nWhat --quality sets\n  %-14s%16s%16s%18s%15s\n", "", "samples-direct", "samples-bounce",
                  "samples-indirect", "samples-probe");
    for (size_t i = 0; i < kiln_quality_count; i++)
        (void)fprintf(stream, "  %-14s%16u%16u%18u%15u\n", kiln_qualities[i].name, kiln_qualities[i].samples_direct,
                      kiln_qualities[i].samples_bounce, kiln_qualities[i].samples_indirect,
                      kiln_qualities[i].samples_probe);
}

/* What coordinator/job/changes.h and coordinator/import/changes.c have. */
static void print_changes(FILE *stream)
{
    (void)fprintf(stream, "\nCHANGES.yaml names what changes; names may be patterns (lamp*), numbers one or three\n"
                          "  lights:      {NAME: {scale: 0.5, intensity: [R, G, B], on: false}}\n"
                          "  materials:   {NAME: {emission: [R, G, B], emission-scale: 2, on: false, "
                          "albedo: [R, G, B]}}\n"
                          "  environment: {scale: 2, radiance: [R, G, B], rotation: DEGREES, on: false}\n");
}

/* What --show takes; sentences are wrapped. */
static void print_shows(FILE *stream)
{
    enum { COLUMN = 36, WIDTH = 118 };
    const char *name, *unit, *sentence;
    (void)fprintf(stream, "\nWhat --show shows, and its unit (light: that of the bake)\n");
    for (size_t i = 0; kiln_show_row(i, &name, &unit, &sentence); i++) {
        int column = fprintf(stream, "  %-20s%-14s", name, unit[0] != '\0' ? unit : "light");
        for (const char *word = sentence; *word != '\0';) {
            const int length = (int)strcspn(word, " ");
            if (column + length > WIDTH)
                column = fprintf(stream, "\n%*s", COLUMN, "") - 1;
            column += fprintf(stream, "%.*s ", length, word);
            word += length + (word[length] == ' ' ? 1 : 0);
        }
        (void)fputc('\n', stream);
    }
}

static void command_screen(FILE *stream, const struct kiln_command *command)
{
    (void)fprintf(stream, "kiln %s: %s\n\nUsage: kiln %s %s [options]\n\nExamples\n", command->name, command->summary,
                  command->name, command->arguments);
    for (size_t i = 0; command->examples[i] != NULL; i++)
        (void)fprintf(stream, "  %s\n", command->examples[i]);
    const char *group = NULL;
    for (size_t i = 0; i < kiln_option_count; i++) {
        if ((kiln_options[i].commands & command->bit) == 0)
            continue;
        if (group == NULL || strcmp(group, kiln_options[i].group) != 0)
            (void)fprintf(stream, "\n%s\n", kiln_options[i].group);
        group = kiln_options[i].group;
        print_option(stream, &kiln_options[i]);
    }
    if ((kiln_option_find("quality")->commands & command->bit) != 0)
        print_qualities(stream);
    if (command->bit == KILN_FOR_RELIGHT)
        print_changes(stream);
    if (command->bit == KILN_FOR_VIEW)
        print_shows(stream);
    if (command->scene)
        (void)fprintf(
            stream,
            "\nA job file is YAML: the same names without the dashes, and `scene`; paths in it are relative to it.\n"
            "Later wins: defaults, --quality, the job file, the command line.\n");
}

static void overview(FILE *stream)
{
    (void)fprintf(stream,
                  "kiln %s bakes the diffuse light of a static scene into lightmaps and an irradiance volume.\n"
                  "  kiln generate cornell -o cornell.glb                 make a scene\n"
                  "  kiln bake cornell.glb -o out                         bake it\n"
                  "  mpirun -n 4 --bind-to none kiln bake cornell.glb -o out     the same on four ranks\n"
                  "  kiln view out -o view.png                            look at it\n\nCommands\n",
                  KILN_VERSION);
    for (size_t i = 0; i < kiln_command_count; i++)
        (void)fprintf(stream, "  %-10s%s\n", kiln_commands[i].name, kiln_commands[i].summary);
    (void)fprintf(stream, "kiln COMMAND --help shows a command's examples, options, units and defaults.\n");
}

void kiln_help(FILE *stream, const struct kiln_command *command)
{
    if (command == NULL)
        overview(stream);
    else
        command_screen(stream, command);
}
