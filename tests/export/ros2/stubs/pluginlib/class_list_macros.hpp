// In place of pluginlib's header of this name.
#pragma once
#define PLUGINLIB_EXPORT_CLASS(Class, Base) \
    std::unique_ptr<Base> made_by_the_plugin() { return std::make_unique<Class>(); }
