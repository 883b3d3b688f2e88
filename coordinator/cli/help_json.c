/* kiln --help --json: the tables of commands and options for programs, such as studies. */
#include <stdlib.h>

#include "coordinator/cli/help_json.h"
#include "coordinator/files/json.h"
#include "coordinator/job/options.h"

static json_t *text_or_null(const char *text) { return text != NULL ? json_string(text) : json_null(); }

static json_t *commands_json(uint32_t commands)
{
    json_t *names = json_array();
    for (size_t i = 0; i < kiln_command_count; i++)
        if ((commands & kiln_commands[i].bit) != 0)
            (void)json_array_append_new(names, json_string(kiln_commands[i].name));
    return names;
}

static json_t *option_json(const struct kiln_option *option)
{
    json_t *choices = json_array();
    for (size_t i = 0; option->choices != NULL && option->choices[i] != NULL; i++)
        (void)json_array_append_new(choices, json_string(option->choices[i]));
    return json_pack("{s:s, s:o, s:s, s:b, s:o, s:o, s:s, s:s, s:o}", "name", option->name, "former",
                     text_or_null(option->former), "group", option->group, "flag", option->kind == KILN_OPTION_FLAG,
                     "value", text_or_null(option->value), "choices", choices, "default", kiln_option_default(option),
                     "help", option->help, "commands", commands_json(option->commands));
}

static json_t *quality_json(const struct kiln_quality *q)
{
    return json_pack("{s:s, s:f, s:i, s:i, s:i, s:i}", "name", q->name, "error", 0.01 * q->error, "samples-direct",
                     (int)q->samples_direct, "samples-bounce", (int)q->samples_bounce, "samples-indirect",
                     (int)q->samples_indirect, "samples-probe", (int)q->samples_probe);
}

int kiln_help_json(const struct kiln_command *command, struct kiln_error *error)
{
    json_t *commands = json_array(), *options = json_array(), *qualities = json_array();
    for (size_t i = 0; i < kiln_command_count; i++)
        if (command == NULL || command == &kiln_commands[i])
            (void)json_array_append_new(commands,
                                        json_pack("{s:s, s:s, s:s}", "name", kiln_commands[i].name, "arguments",
                                                  kiln_commands[i].arguments, "summary", kiln_commands[i].summary));
    for (size_t i = 0; i < kiln_option_count; i++)
        if (command == NULL || (kiln_options[i].commands & command->bit) != 0)
            (void)json_array_append_new(options, option_json(&kiln_options[i]));
    for (size_t i = 0; i < kiln_quality_count; i++)
        (void)json_array_append_new(qualities, quality_json(&kiln_qualities[i]));
    json_t *job =
        json_pack("{s:s, s:s}", "scene", "the scene file", "parts",
                  "in its place a list of files: {name, file, at}, where `at` is a place or a list of places, "
                  "{translation, rotation, scale} or the four rows of a matrix");
    return kiln_json_print(json_pack("{s:s, s:o, s:o, s:o, s:o}", "kiln", KILN_VERSION, "commands", commands, "options",
                                     options, "job_keys", job, "qualities", qualities),
                           error);
}
