#include "coordinator/cli/help_text.h"

#include <string.h>

static void add(char *text, size_t size, const char *before, const char *more)
{
    const size_t used = strlen(text);
    (void)snprintf(text + used, size - used, "%s%s", before, more);
}

void kiln_help_head(const struct kiln_option *option, char text[KILN_HELP_HEAD])
{
    const struct kiln_option *second = kiln_option_second(option);
    (void)snprintf(text, KILN_HELP_HEAD, "%s--%s", strcmp(option->name, "output") == 0 ? "-o, " : "", option->name);
    const char *separator = " ";
    if (option->value != NULL && !option->percentage) {
        add(text, KILN_HELP_HEAD, separator, option->value);
        separator = "|";
    }
    if (option->may_be_infinite)
        add(text, KILN_HELP_HEAD, separator, "inf");
    if (option->word != NULL)
        add(text, KILN_HELP_HEAD, separator, option->word);
    for (size_t i = 0; option->choices != NULL && option->choices[i] != NULL; i++) {
        add(text, KILN_HELP_HEAD, separator, option->choices[i]);
        separator = "|";
    }
    if (option->percentage)
        add(text, KILN_HELP_HEAD, separator, option->value);
    if (second != NULL) {
        add(text, KILN_HELP_HEAD, "[:", second->value);
        add(text, KILN_HELP_HEAD, "]", "");
    }
}

void kiln_help_sentence(const struct kiln_option *option, const struct kiln_command *command,
                        char text[KILN_HELP_SENTENCE])
{
    const char *value = kiln_option_default(option);
    const struct kiln_option *second = kiln_option_second(option);
    const bool output = strcmp(option->name, "output") == 0 && command != NULL;
    (void)snprintf(text, KILN_HELP_SENTENCE, "%s", output ? command->output : option->help);
    if (second != NULL) {
        add(text, KILN_HELP_SENTENCE, "; ", second->value);
        add(text, KILN_HELP_SENTENCE, ": ", second->help);
    }
    if (value[0] == '\0')
        return;
    add(text, KILN_HELP_SENTENCE, " (default ", value);
    if (option->kind == KILN_OPTION_FLAG)
        add(text, KILN_HELP_SENTENCE, "; --no-", option->name);
    if (second != NULL) {
        add(text, KILN_HELP_SENTENCE, ", ", second->value);
        add(text, KILN_HELP_SENTENCE, " ", kiln_option_default(second));
    }
    add(text, KILN_HELP_SENTENCE, ")", "");
}

static bool has_common(const struct kiln_command *command)
{
    for (size_t i = 0; i < kiln_option_count; i++)
        if ((kiln_options[i].common & command->bit) != 0)
            return true;
    return false;
}

bool kiln_help_has(const struct kiln_command *command, const struct kiln_option *option, bool all)
{
    return (option->commands & command->bit) != 0 && option->second_of == NULL &&
           (all || (option->common & command->bit) != 0 || !has_common(command));
}
