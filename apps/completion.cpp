// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <functional>
#include <memory>

#include "apps/board/board_commands.h"
#include "sim/base/errors.h"
#include "sim/base/text/listed.h"
#include "sim/base/version.h"

namespace earshot {
namespace {

/// A command with its words, "dataset episodes", and the options that its help shows.
struct Command {
  std::vector<std::string> words;
  const CLI::App* app;
  [[nodiscard]] std::string name() const { return listed(words, " "); }
};

void collect(const CLI::App& app, const std::vector<std::string>& words, std::vector<Command>& commands) {
  commands.push_back({words, &app});
  for (const CLI::App* child : app.get_subcommands([](const CLI::App*) { return true; })) {
    std::vector<std::string> longer = words;
    longer.push_back(child->get_name());
    collect(*child, longer, commands);
  }
}

std::vector<const CLI::Option*> shown_options(const CLI::App& app) {
  return app.get_options([](const CLI::Option* option) { return !option->get_group().empty(); });
}

std::vector<std::string> flags_of(const CLI::Option& option) {
  std::vector<std::string> flags;
  for (const std::string& name : option.get_snames()) flags.push_back("-" + name);
  for (const std::string& name : option.get_lnames()) flags.push_back("--" + name);
  return flags;
}

std::vector<std::string> children_of(const CLI::App& app) {
  std::vector<std::string> names;
  for (const CLI::App* child : app.get_subcommands([](const CLI::App*) { return true; })) names.push_back(child->get_name());
  return names;
}

std::string bash_script(const std::vector<Command>& commands) {
  std::string script =
      "# Completion of earshot for bash: source <(earshot completion bash)\n"
      "_earshot() {\n"
      "  local current=${COMP_WORDS[COMP_CWORD]} command= word i\n"
      "  for ((i = 1; i < COMP_CWORD; ++i)); do\n"
      "    word=${COMP_WORDS[i]}\n"
      "    case \"$command $word\" in\n";
  std::string known;
  for (const Command& command : commands)
    if (!command.words.empty()) known += (known.empty() ? "" : "|") + fmt::format("' {}'", command.name());
  script += fmt::format("      {}) command=\"$command $word\" ;;\n    esac\n  done\n  local words=\n  case \"$command\" in\n", known);
  for (const Command& command : commands) {
    std::vector<std::string> words = children_of(*command.app);
    for (const CLI::Option* option : shown_options(*command.app))
      for (const std::string& flag : flags_of(*option)) words.push_back(flag);
    script += fmt::format("    '{}') words='{}' ;;\n", command.words.empty() ? "" : " " + command.name(), listed(words, " "));
  }
  // Files where no option begins: most arguments are files, and -o default leaves them to bash.
  return script +
         "  esac\n"
         "  if [[ $current == -* || $command == '' || $words != -* ]]; then mapfile -t COMPREPLY < <(compgen -W \"$words\" -- "
         "\"$current\"); fi\n"
         "}\n"
         "complete -o default -F _earshot earshot\n";
}

/// Within '...[text]' of zsh's _arguments.
std::string zsh_text(const std::string& text, bool in_brackets) {
  std::string out;
  for (const char c : text.substr(0, text.find('\n'))) {
    if (c == '\'')
      out += "'\\''";
    else if (c == ':' || (in_brackets && (c == '[' || c == ']')))
      out += std::string("\\") + c;
    else
      out += c;
  }
  return out;
}

std::string zsh_script(const std::vector<Command>& commands) {
  std::string script =
      "#compdef earshot\n# Completion of earshot for zsh: earshot completion zsh > a file _earshot in a folder of $fpath\n";
  const auto function_of = [](const Command& command) {
    std::string name = "_earshot";
    for (const std::string& word : command.words) name += "_" + word;
    return name;
  };
  for (const Command& command : commands) {
    script += function_of(command) + "() {\n  _arguments -C \\\n";
    for (const CLI::Option* option : shown_options(*command.app)) {
      if (option->get_positional()) continue;
      const bool takes = option->get_items_expected_max() > 0;
      for (const std::string& flag : flags_of(*option))
        script += fmt::format("    '*{}[{}]{}' \\\n", flag, zsh_text(option->get_description(), true), takes ? ":value:_files" : "");
    }
    const auto children = command.app->get_subcommands([](const CLI::App*) { return true; });
    if (children.empty()) {
      script += "    '*:file:_files'\n}\n";
      continue;
    }
    script += "    '1: :->command' '*:: :->rest'\n  case $state in\n    command)\n      local -a commands=(\n";
    for (const CLI::App* child : children)
      script += fmt::format("        '{}:{}'\n", child->get_name(), zsh_text(child->get_description(), false));
    script += "      )\n      _describe command commands ;;\n    rest)\n      case $words[1] in\n";
    for (const CLI::App* child : children) script += fmt::format("        {0}) {1}_{0} ;;\n", child->get_name(), function_of(command));
    script += "      esac ;;\n  esac\n}\n";
  }
  return script + "_earshot \"$@\"\n";
}

/// Text of a man page: a dot or a quote at the beginning of a line would be a request, and '-' a hyphen.
std::string roff(const std::string& text) {
  std::string out;
  bool begins = true;
  for (const char c : text) {
    if (begins && (c == '.' || c == '\'')) out += "\\&";
    if (c == '\\')
      out += "\\e";
    else if (c == '-')
      out += "\\-";
    else
      out += c;
    begins = c == '\n';
  }
  return out;
}

/// Paragraphs of options with their flags, values and descriptions.
std::string man_options(const CLI::App& app, bool with_help) {
  std::string out;
  for (const CLI::Option* option : shown_options(app)) {
    if (option->check_lname("help") && !with_help) continue;
    const std::string value = option->get_items_expected_max() > 0 ? option->get_type_name() : "";
    out += fmt::format(".TP\n.B {}\n{}\n", roff(option->get_name(true, true) + (value.empty() ? "" : " " + value)),
                       roff(option->get_description()));
  }
  return out;
}

std::string man_page(const std::vector<Command>& commands) {
  const CLI::App& app = *commands.front().app;
  // Scenes and options are long words that no line can be filled with evenly.
  std::string page = fmt::format(
      ".TH EARSHOT 1 \"\" \"earshot {}\" \"User Commands\"\n.ad l\n.SH NAME\nearshot \\- {}\n.SH SYNOPSIS\n.B earshot\nCOMMAND [OPTIONS]\n",
      kVersion, roff(app.get_description()));
  page += ".SH DESCRIPTION\n" + roff(app.get_footer()) + "\n.SH OPTIONS\n" + man_options(app, true) + ".SH COMMANDS\n";
  for (const Command& command : commands) {
    if (command.words.empty()) continue;
    page += fmt::format(".SS \"earshot {}\"\n{}\n{}", roff(command.name()), roff(command.app->get_description()),
                        man_options(*command.app, false));
    if (const std::string footer = command.app->get_footer(); !footer.empty() && footer != app.get_footer())
      page += ".PP\n.nf\n" + roff(footer) + "\n.fi\n";
  }
  return page;
}

}  // namespace

void add_completion(CLI::App& app) {
  auto kind = std::make_shared<std::string>();
  CLI::App* command = app.add_subcommand("completion", "Print a completion script for bash or zsh, or the manual page");
  command->add_option("KIND", *kind, "Script to print: bash, zsh, or man for the manual page")
      ->required()
      ->check(CLI::IsMember({"bash", "zsh", "man"}));
  command->footer(
      "bash: earshot completion bash > ~/.local/share/bash-completion/completions/earshot\n"
      "zsh:  earshot completion zsh > _earshot, in a folder of $fpath\n"
      "man:  earshot completion man > ~/.local/share/man/man1/earshot.1");
  command->callback([kind, &app] {
    std::vector<Command> commands;
    collect(app, {}, commands);
    fmt::print("{}", *kind == "bash" ? bash_script(commands) : *kind == "zsh" ? zsh_script(commands) : man_page(commands));
  });
}

}  // namespace earshot
