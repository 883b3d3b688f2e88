/* Makes a script for the completion of kiln's commands, their options and the options' values in a shell. */
#include <string.h>

#include "coordinator/cli/help_text.h"
#include "coordinator/generate/scenes.h"
#include "coordinator/view/show.h"

static const char head[] = "# Completes kiln's command line, made by kiln --completion bash. In ~/.bashrc:\n"
                           "#   source <(kiln --completion bash)\n"
                           "# In zsh: autoload -U +X bashcompinit && bashcompinit, and the same line.\n";

/* End of the script. @file, @folder and @scene stand for file names, folder names and names of generated scenes. */
static const char tail[] =
    "# Prints those of the words $1 that begin with $2.\n"
    "_kiln_matching() {\n"
    "    local word ending\n"
    "    for word in $1; do\n"
    "        case $word in\n"
    "        @file) compgen -f -- \"$2\" ;;\n"
    "        @folder) compgen -d -- \"$2\" ;;\n"
    "        @scene)\n"
    "            compgen -d -- \"$2\"\n"
    "            for ending in glb gltf obj yaml yml; do compgen -f -X \"!*.$ending\" -- \"$2\"; done\n"
    "            ;;\n"
    "        \"$2\"*) echo \"$word\" ;;\n"
    "        esac\n"
    "    done\n"
    "}\n"
    "\n"
    "_kiln() {\n"
    "    local current=\"${COMP_WORDS[COMP_CWORD]}\" before=\"${COMP_WORDS[COMP_CWORD-1]}\" prefix= command= words= i\n"
    "    local IFS=$' \\t\\n'\n"
    "    COMPREPLY=()\n"
    "    case $current in\n"
    "    =) current= ;;\n"
    "    --*=*) before=\"${current%%=*}\" prefix=\"${current%%=*}=\" current=\"${current#*=}\" ;;\n"
    "    *) [[ $before == = ]] && before=\"${COMP_WORDS[COMP_CWORD-2]}\" ;;\n"
    "    esac\n"
    "    [[ $before == : || $current == : ]] && return\n"
    "    for ((i = 1; i < COMP_CWORD; i++)); do\n"
    "        case ${COMP_WORDS[i]} in -* | help) ;; *) command=\"${COMP_WORDS[i]}\"; break ;; esac\n"
    "    done\n"
    "    if [[ $before == --help || $before == -h ]]; then\n"
    "        words=all\n"
    "    elif [[ -z $command ]]; then\n"
    "        words=\"$_kiln_commands help --help --version\"\n"
    "    elif [[ ${COMP_WORDS[1]} == help ]]; then\n"
    "        words=all\n"
    "    elif words=\"$(_kiln_values \"$command:$before\")\"; then\n"
    "        :\n"
    "    elif [[ $current == -* ]]; then\n"
    "        words=\"$(_kiln_options \"$command\") --help\"\n"
    "    else\n"
    "        words=\"$(_kiln_arguments \"$command\")\"\n"
    "    fi\n"
    "    [[ \" $words \" == *\\ @* ]] && compopt -o filenames 2> /dev/null\n"
    "    IFS=$'\\n'\n"
    "    COMPREPLY=($(IFS=$' \\t\\n'; _kiln_matching \"$words\" \"$current\" | sort -u))\n"
    "    COMPREPLY=(\"${COMPREPLY[@]/#/$prefix}\")\n"
    "}\n"
    "complete -F _kiln kiln\n";

static void print_commands(FILE *stream)
{
    (void)fputs("\n_kiln_commands=\"", stream);
    for (size_t i = 0; i < kiln_command_count; i++)
        (void)fprintf(stream, "%s%s", i == 0 ? "" : " ", kiln_commands[i].name);
    (void)fputs("\"\n", stream);
}

/* Prints each command's options. A switch that is on by default is offered in the form that turns it off. */
static void print_options(FILE *stream)
{
    (void)fputs("\n_kiln_options() {\n    case $1 in\n", stream);
    for (size_t c = 0; c < kiln_command_count; c++) {
        (void)fprintf(stream, "    %s) echo \"", kiln_commands[c].name);
        const char *separator = "";
        for (size_t i = 0; i < kiln_option_count; i++) {
            const struct kiln_option *option = &kiln_options[i];
            const bool on = option->kind == KILN_OPTION_FLAG && strcmp(option->fallback, "true") == 0;
            if (!kiln_help_has(&kiln_commands[c], option, true))
                continue;
            (void)fprintf(stream, "%s--%s%s", separator, on ? "no-" : "", option->name);
            separator = " ";
        }
        (void)fputs("\" ;;\n", stream);
    }
    (void)fputs("    esac\n}\n", stream);
}

static bool is_alone(const struct kiln_option *option)
{
    size_t count = 0;
    for (size_t i = 0; i < kiln_option_count; i++)
        count += strcmp(kiln_options[i].name, option->name) == 0;
    return count == 1;
}

/* The option as the pattern of a case: *:--unit, or bake:--atlas|view:--atlas where other commands have another. */
static void print_pattern(FILE *stream, const struct kiln_option *option)
{
    const char *separator = "";
    if (is_alone(option)) {
        (void)fprintf(stream, "*:--%s", option->name);
        return;
    }
    for (size_t c = 0; c < kiln_command_count; c++)
        if ((kiln_commands[c].bit & option->commands) != 0) {
            (void)fprintf(stream, "%s%s:--%s", separator, kiln_commands[c].name, option->name);
            separator = " | ";
        }
}

static void print_shows(FILE *stream)
{
    const char *name, *unit, *sentence;
    for (size_t i = 0; kiln_show_row(i, &name, &unit, &sentence); i++)
        if (strchr(name, ':') == NULL)
            (void)fprintf(stream, " %s", name);
}

static void print_words(FILE *stream, const struct kiln_option *option)
{
    const bool folder =
        option->value != NULL && (strncmp(option->value, "FOLDER", 6) == 0 || strcmp(option->value, "DIR") == 0);
    for (size_t i = 0; option->choices != NULL && option->choices[i] != NULL; i++)
        (void)fprintf(stream, " %s", option->choices[i]);
    for (const struct kiln_option_word *w = option->words; w != NULL && w->word != NULL; w++)
        (void)fprintf(stream, " %s", w->word);
    if (option->may_be_infinite)
        (void)fputs(" inf", stream);
    if (option->word != NULL)
        (void)fprintf(stream, " %s", option->word);
    if (option->other_word != NULL)
        (void)fprintf(stream, " %s", option->other_word);
    if (option->kind == KILN_OPTION_ENVIRONMENT)
        (void)fputs(" none @file", stream);
    if (option->kind == KILN_OPTION_PATH)
        (void)fputs(folder ? " @folder" : " @file", stream);
    if (strcmp(option->name, "show") == 0)
        print_shows(stream);
}

/* Fails for what takes no value. */
static void print_values(FILE *stream)
{
    (void)fputs("\n_kiln_values() {\n    case $1 in\n    *:-o) echo @file ;;\n", stream);
    for (size_t i = 0; i < kiln_option_count; i++) {
        if (kiln_options[i].kind == KILN_OPTION_FLAG || kiln_options[i].second_of != NULL)
            continue;
        (void)fputs("    ", stream);
        print_pattern(stream, &kiln_options[i]);
        (void)fputs(") echo", stream);
        print_words(stream, &kiln_options[i]);
        (void)fputs(" ;;\n", stream);
    }
    (void)fputs("    *) return 1 ;;\n    esac\n}\n", stream);
}

static void print_arguments(FILE *stream)
{
    (void)fputs("\n_kiln_arguments() {\n    case $1 in\n", stream);
    for (size_t c = 0; c < kiln_command_count; c++) {
        const struct kiln_command *command = &kiln_commands[c];
        const bool scene = strstr(command->arguments, "SCENE") != NULL;
        (void)fprintf(stream, "    %s) echo", command->name);
        if (command->words != NULL)
            (void)fprintf(stream, " %s", command->words);
        for (size_t i = 0; command->bit == KILN_FOR_GENERATE && i < kiln_generator_count; i++)
            (void)fprintf(stream, " %s", kiln_generators[i].name);
        if (command->bit != KILN_FOR_GENERATE)
            (void)fputs(scene ? " @scene" : command->maximum > 1 ? " @file" : " @folder", stream);
        (void)fputs(" ;;\n", stream);
    }
    (void)fputs("    esac\n}\n\n", stream);
}

void kiln_completion_print(FILE *stream)
{
    (void)fputs(head, stream);
    print_commands(stream);
    print_options(stream);
    print_values(stream);
    print_arguments(stream);
    (void)fputs(tail, stream);
}
